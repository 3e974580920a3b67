// Native code of cma_es_learning.py: a section for each function, which Warp puts into the function's body.

// ==== lay_out
    const int words = copy.shape[1], rows = copy.shape[0], dofs = axes.shape[0];
    #pragma unroll 4
    for (int k = lane; k < rows * words; k += lanes) {
        const int j = k / words, i = k - j * words;
        copy.data[k] = i < dofs && j < dofs ? axes.data[j * dofs + i] : 0.0f;
    }

// ==== turned
#if !defined(__CUDA_ARCH__)
    #pragma clang fp contract(off)
#endif
    const int dofs = lengths.shape[0], words = axes.shape[1];
    const float* __restrict__ component = axes.data + i;
    const float* __restrict__ mean = mean_z.data;
    const float* __restrict__ length = lengths.data;
    float step = 0.0f, whitened = 0.0f;
    for (int j = 0; j < dofs; ++j) {
        const float along = component[j * words] * mean[j];
        step += along * length[j];
        whitened += along;
    }
    return wp::vec2(step, whitened);

// ==== dot
#if !defined(__CUDA_ARCH__)
    #pragma clang fp contract(off)
#endif
    const float* __restrict__ a = matrix.data + row * matrix.shape[1];
    const float* __restrict__ b = vector.data;
    const int count = vector.shape[1];
    float total = 0.0f;
    for (int i = 0; i < count; ++i) total += a[i] * b[i];
    return total;

// ==== write_covariance
#if !defined(__CUDA_ARCH__)
    #pragma clang fp contract(off)
#endif
    const int dofs = lengths.shape[0], n = start.shape[0];
    const float* __restrict__ normal = z.data;
    const float* __restrict__ weights = weight.data;
    const float* __restrict__ length = lengths.data;
    const float* __restrict__ along = path_along.data;
    const int* __restrict__ place = start.data;
    const int* best = order.data;
    auto write = [&](int i, int j) {
        float value = 0.0f;
        if (j < dofs) {
            float rank_mu = 0.0f;
            #pragma unroll 4
            for (int r = 0; r < mu; ++r) {
                const float* parent = normal + best[r] * dofs;
                rank_mu += weights[r] * parent[i] * parent[j];
            }
            const float spread = length[i] * length[j];
            value = c_cov * (share * (along[i] * along[j]) + (1.0f - share) * spread * rank_mu);
            if (i == j) value += kept * spread;
        }
        elements.data[place[i * n + j]] = value;
    };
#if defined(__CUDA_ARCH__)
    // The rows i and n - 1 - i of the upper triangle have n + 1 elements together: lanes share a rectangle.
    for (int k = lane; k < n / 2 * (n + 1); k += lanes) {
        const int row = k / (n + 1), left = k - row * (n + 1), ahead = left - (n - row);
        if (ahead < 0) write(row, row + left);
        else write(n - 1 - row, n - 1 - row + ahead);
    }
#else
    for (int i = 0; i < n; ++i) {
        for (int j = i; j < n; ++j) write(i, j);
    }
#endif
