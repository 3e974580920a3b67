// Native code of normal_equations.py: a section for each function, which Warp puts into the function's body.

// ==== sum_serially
    for (int s = 0; s < count; ++s) {
        const float weight = weighted.data[first + s][1];
        if (!(weight > 0.0f)) continue;
        const float* z = rows.data + (size_t)(first + s) * width;
        float* sum = triangle.data + at;
        for (int i = 0; i < width; sum += ++i) {
            const float scaled = weight * z[i];
            if (scaled == 0.0f) continue;
            for (int j = 0; j <= i; ++j) sum[j] += scaled * z[j];
        }
    }

// ==== sum_together
#if defined(__CUDA_ARCH__)
    // 40 KB hold so many rows at a time, and their weights behind them.
    const int most = words.shape[0] / (width + 1);
    float* row = (float*)words.data;
    float* weight = row + most * width;
    const float* from = rows.data + (size_t)first * width;
    int down = 0;
    while ((down + 1) * (down + 2) / 2 <= tile) ++down;
    const int i = 2 * down, j = 2 * (tile - down * (down + 1) / 2);
    const bool mine = i < width;
    const int below = i + 1 < width ? i + 1 : i, beside = j + 1 < width ? j + 1 : j;
    float sum00 = 0.0f, sum01 = 0.0f, sum10 = 0.0f, sum11 = 0.0f;
    for (int begin = 0; begin < count; begin += most) {
        const int held = count - begin < most ? count - begin : most;
        __syncthreads();
        for (int r = lane; r < held; r += lanes) weight[r] = __ldg(&weighted.data[first + begin + r][1]);
        __syncthreads();
        #pragma unroll 8
        for (int w = lane; w < held * width; w += lanes) {
            const float value = __ldg(from + (size_t)begin * width + w);
            row[w] = weight[w / width] > 0.0f ? value : 0.0f;
        }
        __syncthreads();
        if (!mine) continue;
        float total00 = 0.0f, total01 = 0.0f, total10 = 0.0f, total11 = 0.0f;
        #pragma unroll 4
        for (int r = 0; r < held; ++r) {
            const float* z = row + r * width;
            const float upper = weight[r] * z[i], lower = weight[r] * z[below], left = z[j], right = z[beside];
            total00 += upper * left;
            total01 += upper * right;
            total10 += lower * left;
            total11 += lower * right;
        }
        sum00 += total00;
        sum01 += total01;
        sum10 += total10;
        sum11 += total11;
    }
    if (!mine) return;
    float* to = triangle.data + at + i * (i + 1) / 2;
    to[j] = sum00;
    if (j < beside && beside <= i) to[beside] = sum01;
    if (i == below) return;
    to += i + 1;  // the next row
    to[j] = sum10;
    if (j < beside) to[beside] = sum11;
#endif
