// Native code of raster.py: a section for each function, which Warp puts into the function's body.

// ==== clear
#if defined(__CUDA_ARCH__)
    for (int i = lane; i < words; i += lanes) steps.data[i] = 0x80808080u;
    __syncthreads();
#else
    unsigned int* p = (unsigned int*)steps.data;
    for (int i = 0; i < words; ++i) p[i] = 0x80808080u;
#endif
