// Native code of block.py: a section for each function, which Warp puts into the function's body.

// ==== sync
#if defined(__CUDA_ARCH__)
    __syncthreads();
#endif

// ==== sync_warp
#if defined(__CUDA_ARCH__)
    __syncwarp();
#endif

// ==== words
#if defined(__CUDA_ARCH__)
    __shared__ unsigned int words[${WORDS}];
    return (wp::uint64)words;
#else
    return (wp::uint64)scratch.data;
#endif

// ==== numbers
#if defined(__CUDA_ARCH__)
    __shared__ int numbers[${NUMBERS}];
    return (wp::uint64)numbers;
#else
    return (wp::uint64)(scratch.data + ${WORDS});
#endif

// ==== warp_sum
#if defined(__CUDA_ARCH__)
    for (int step = 16; step > 0; step /= 2) value += __shfl_xor_sync(0xFFFFFFFFu, value, step);
#endif
    return value;

// ==== warp_max
#if defined(__CUDA_ARCH__)
    for (int step = 16; step > 0; step /= 2) value = max(value, __shfl_xor_sync(0xFFFFFFFFu, value, step));
#endif
    return value;
