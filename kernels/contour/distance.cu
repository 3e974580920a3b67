// Native code of distance.py: a section for each function, which Warp puts into the function's body.

// ==== bounds
    const int columns = word.shape[3], words = word.shape[2] * columns;
    const unsigned int* all = &wp::index(word, f, k, 0, 0);
    int left = 1 << 30, top = 1 << 30, right = -1, bottom = -1;
    for (int i = lane; i < words; i += lanes) {
        const unsigned int bits = all[i];
        if (bits == 0) continue;
        const int row = i / columns, x = 32 * (i - row * columns);
#if defined(__CUDA_ARCH__)
        const int lowest = __ffs((int)bits) - 1, highest = 31 - __clz((int)bits);
#else
        const int lowest = __builtin_ctz(bits), highest = 31 - __builtin_clz(bits);
#endif
        left = x + lowest < left ? x + lowest : left;
        right = x + highest > right ? x + highest : right;
        top = row < top ? row : top;
        bottom = row;
    }
    return wp::vec4i(left, top, right, bottom);

// ==== unpack
    const unsigned int* row = &wp::index(word, f, k, y, 0);
    unsigned char* to = inside.data + first;
    for (int i = 0; i < count; ++i) {
        int at = x + i;
        at = at < 0 ? 0 : at >= width ? width - 1 : at;
        to[i] = (row[at >> 5] >> (at & 31)) & 1u;
    }

// ==== search_rows
    const unsigned char* in = inside.data + first;
    unsigned char* to = across.data + first;
    for (int i = 0; i < count; ++i) {
        unsigned char nearest = ${FARTHEST_SQUARED};
        #pragma unroll
        for (int d = ${MOST_STEPS}; d > 0; --d) {
            const unsigned char other = (in[i] ^ in[i - d]) | (in[i] ^ in[i + d]);
            nearest = other ? (unsigned char)(d * d) : nearest;
        }
        to[i] = nearest;
    }

// ==== search_columns
    const unsigned char* in = inside.data + first;
    const unsigned char* row = across.data + first;
    float* to = rough.data + first;
    for (int i = 0; i < count; ++i) {
        unsigned char nearest = ${FARTHEST_SQUARED};
        #pragma unroll
        for (int d = ${FIRST_STEP}; d < ${FARTHEST}; ++d) {
            const int at = i + d * width;
            const unsigned char along = row[at] & (unsigned char)((in[at] ^ in[i]) - 1);  // 0 on the other side
            const unsigned char square = (unsigned char)(along + d * d);
            nearest = square < nearest ? square : nearest;
        }
        const float distance = sqrtf((float)nearest) - 0.5f;
        to[i] = in[i] ? -distance : distance;
    }

// ==== blur
    const float outer = 0.05448868f, inner = 0.24420135f, middle = 0.40261996f;
    const float* row = rough.data + centre;
    float* to = value.data + first;
    for (int i = 0; i < count; ++i) {
        float total = 0.0f;
        #pragma unroll
        for (int d = -2; d <= 2; ++d) {
            const float* at = row + i + d * width;
            const float along = outer * (at[-2] + at[2]) + inner * (at[-1] + at[1]) + middle * at[0];
            total += (d == 0 ? middle : d == 1 || d == -1 ? inner : outer) * along;
        }
        to[i] = total;
    }
