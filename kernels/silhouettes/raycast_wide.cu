// Native code of raycast_wide.py: a section for each function, which Warp puts into the function's body.

// ==== ballot
#if defined(__CUDA_ARCH__)
    return __ballot_sync(0xFFFFFFFFu, vote);
#else
    return vote ? 1u : 0u;
#endif
