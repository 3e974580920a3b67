// Native code of descent.py: a section for each function, which Warp puts into the function's body.

// ==== product
#if defined(__CUDA_ARCH__)
    return __fmul_rn(a, b);
#else
    return a * b;
#endif
