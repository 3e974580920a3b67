// Native code of cma_es.py: a section for each function, which Warp puts into the function's body.

// ==== transform
#if !defined(__CUDA_ARCH__)
    #pragma clang fp contract(off)
#endif
    const int dofs = radius.shape[0];
    const float* __restrict__ row = axes.data;
    const float* __restrict__ length = lengths.data;
    const float* __restrict__ normal = z.data;
    float* __restrict__ sum = x.data;
#if defined(__CUDA_ARCH__)
    for (int i = column; i < dofs; i += columns) {
        float y = 0.0f;
        #pragma unroll 8  // a lane waits once for many numbers
        for (int j = 0; j < dofs; ++j) y += row[j * dofs + i] * length[j] * normal[j];
        sum[i] = mean.data[i] + sigma * radius.data[i] * y;
    }
#else
    for (int i = 0; i < dofs; ++i) sum[i] = 0.0f;
    for (int j = 0; j < dofs; ++j) {
        for (int i = 0; i < dofs; ++i) sum[i] += row[j * dofs + i] * length[j] * normal[j];
    }
    for (int i = 0; i < dofs; ++i) sum[i] = mean.data[i] + sigma * radius.data[i] * sum[i];
#endif
