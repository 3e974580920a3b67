// Native code of eigen.py: a section for each function, which Warp puts into the function's body.

// ==== SEATS
    int first_row = round + k, second_row = round - k;
    if (first_row >= others) first_row -= others;
    if (second_row < 0) second_row += others;
    if (k == 0) second_row = others;
    float* p = spectrum.axes.data + first_row * spectrum.axes.shape[1];
    float* q = spectrum.axes.data + second_row * spectrum.axes.shape[1];

// ==== CHOOSE
    const float negligible = 3.0e-8f;  // of the larger diagonal element: below what float32 can tell
    const float converged = 1.0e-4f;  // a sweep that meets nothing larger leaves about its square
    const float size = fabsf(pq);
    const float largest = fabsf(pp) > fabsf(qq) ? fabsf(pp) : fabsf(qq);
    const bool rotates = size > negligible * largest;
    large |= rotates & (size > converged * largest);
    const float cot_twice = 0.5f * (qq - pp) * reciprocal(pq);
    const float sin_twice = reciprocal_root(cot_twice * cot_twice + 1.0f);
    const float cos_squared = 0.5f + 0.5f * fabsf(cot_twice) * sin_twice;
    const float secant = reciprocal_root(cos_squared);
    // Where pp = qq, the coordinate with the lower number turns towards the other, whichever of them sits first.
    const bool is_swapped = (k > 0) & (round >= k) & (round + k < others);
    const bool is_negative = is_swapped ? cot_twice <= 0.0f : cot_twice < 0.0f;
    const float s = (is_negative ? -0.5f : 0.5f) * sin_twice * secant;
    const float change = s * secant * pq;
    const float tau = s * reciprocal(1.0f + cos_squared * secant);

// ==== find_rotations
#if !defined(__CUDA_ARCH__)
    #pragma clang fp contract(off)
    auto reciprocal = [](float x) { return 1.0f / x; };
    auto reciprocal_root = [](float x) { return 1.0f / sqrtf(x); };
    const int width = spectrum.rotation.shape[1] / 2, others = 2 * pairs - 1;
    const int* __restrict__ place = tournament.moved.data;
    const float* __restrict__ old = spectrum.elements.data + (now ^ 1) * spectrum.elements.shape[1];
    float* __restrict__ element = spectrum.elements.data + now * spectrum.elements.shape[1];
    float* __restrict__ sine = spectrum.rotation.data;
    float* __restrict__ tangent = spectrum.rotation.data + 2 * width;
    int large = 0;
    for (int k = 0; k < pairs; ++k) {
        const float pp = old[place[k]], qq = old[place[width + k]], pq = old[place[2 * width + k]];
        ${CHOOSE}
        sine[k] = rotates ? s : 0.0f;
        tangent[k] = rotates ? tau : 0.0f;
        sine[pairs + k] = rotates ? s : 0.0f;  // once more, for the pairs that are ahead of the last
        tangent[pairs + k] = rotates ? tau : 0.0f;
        element[k] = rotates ? pp - change : pp;
        element[width + k] = rotates ? qq + change : qq;
        element[2 * width + k] = rotates ? 0.0f : pq;
    }
    return large;
#else
    return 0;
#endif

// ==== rotate_blocks
#if !defined(__CUDA_ARCH__)
    #pragma clang fp contract(off)
    typedef float Numbers __attribute__((vector_size(32), aligned(4)));
    const int width = spectrum.rotation.shape[1] / 2, row = (3 + 4 * (ahead - 1)) * width;
    const int* __restrict__ place = tournament.moved.data + row;
    const float* __restrict__ old = spectrum.elements.data + (now ^ 1) * spectrum.elements.shape[1];
    float* __restrict__ element = spectrum.elements.data + now * spectrum.elements.shape[1] + row;
    auto move = [&](int k) {
        Numbers found;
        for (int i = 0; i < sizeof(Numbers) / sizeof(float); ++i) ((float*)&found)[i] = old[place[k + i]];
        return found;
    };
    auto rotation_of = [&](int k) { return *(const Numbers*)(spectrum.rotation.data + k); };
    for (int k = 0; k < pairs; k += 8) {  // the row is filled up to whole vectors
        const Numbers s = rotation_of(k), tau = rotation_of(2 * width + k);
        const Numbers s_m = rotation_of(k + ahead), tau_m = rotation_of(2 * width + k + ahead);
        const Numbers pp = move(k), pq = move(width + k), qp = move(2 * width + k), qq = move(3 * width + k);
        // Corrections: small ones round far less than products with a cosine do.
        const Numbers left_p = pp - s * (qp + tau * pp), left_q = qp + s * (pp - tau * qp);
        const Numbers right_p = pq - s * (qq + tau * pq), right_q = qq + s * (pq - tau * qq);
        *(Numbers*)(element + k) = left_p - s_m * (right_p + tau_m * left_p);
        *(Numbers*)(element + width + k) = right_p + s_m * (left_p - tau_m * right_p);
        *(Numbers*)(element + 2 * width + k) = left_q - s_m * (right_q + tau_m * left_q);
        *(Numbers*)(element + 3 * width + k) = right_q + s_m * (left_q - tau_m * right_q);
    }
#endif

// ==== rotate_axes
#if !defined(__CUDA_ARCH__)
    #pragma clang fp contract(off)
    typedef float Numbers __attribute__((vector_size(32), aligned(4)));
    const int others = 2 * pairs - 1;
    const float* tangent = spectrum.rotation.data + spectrum.rotation.shape[1];
    for (int k = 0; k < pairs; ++k) {
        const float s = spectrum.rotation.data[k], tau = tangent[k];
        if (s == 0.0f) continue;
        ${SEATS}
        for (int i = 0; i < 2 * pairs; i += 8) {
            const Numbers old_p = *(Numbers*)(p + i), old_q = *(Numbers*)(q + i);
            *(Numbers*)(p + i) = old_p - s * (old_q + tau * old_p);
            *(Numbers*)(q + i) = old_q + s * (old_p - tau * old_q);
        }
    }
#endif

// ==== diagonalize_together
#if defined(__CUDA_ARCH__)
    auto reciprocal = [](float x) { float y; asm("rcp.approx.ftz.f32 %0, %1;" : "=f"(y) : "f"(x)); return y; };
    auto reciprocal_root = [](float x) { float y; asm("rsqrt.approx.ftz.f32 %0, %1;" : "=f"(y) : "f"(x)); return y; };
    const int pairs = spectrum.axes.shape[0] / 2, others = 2 * pairs - 1, blocks = pairs * (pairs - 1) / 2;
    const int width = spectrum.rotation.shape[1] / 2, quarter = 2 * ((2 * pairs + 7) / 8);
    const int* __restrict__ moved = tournament.moved.data;
    // A's rows: four over the blocks; then over the pairs two of the diagonal, those between, and the next of these.
    const int p_row = 4 * blocks, q_row = p_row + pairs, pq_row = q_row + pairs, next_pq_row = pq_row + pairs;

    struct Block { int place[4], k, m; };  // the four elements between two pairs
    auto block_at = [&](int b, int swapped) {
        Block block;
        for (int i = 0; i < 4; ++i) block.place[i] = moved[(i ^ swapped) * blocks + b];
        block.k = b % pairs;
        block.m = block.k + b / pairs + 1;
        if (block.m >= pairs) block.m -= pairs;
        return block;
    };
    struct Next { int pp, qq; Block between; float left_sign, right_sign; };  // where a pair's next elements lie
    auto next_of = [&](int k) {
        Next next;
        next.pp = moved[p_row + k];
        next.qq = moved[q_row + k];
        if (blocks == 0) return next;
        // A second row or column rotates like a first, by the opposite angle, after swapping the two.
        const int from = moved[pq_row + k], which = from / blocks;
        next.between = block_at(from - which * blocks, which);
        next.left_sign = which & 2 ? -1.0f : 1.0f;
        next.right_sign = which & 1 ? -1.0f : 1.0f;
        return next;
    };
    float* element = spectrum.elements.data + spectrum.elements.shape[1];  // after the round, and before it
    float* old = spectrum.elements.data;
    float *sine = spectrum.rotation.data + width, *then_sine = spectrum.rotation.data;  // of the round, and of the next
    // Choose a pair's rotation, and leave it and the rotated elements where the round after this one looks for them.
    int large = 0;
    auto choose = [&](int k, float pp, float qq, float pq, int round, float* after, float* sine_after) {
        ${CHOOSE}
        sine_after[k] = rotates ? s : 0.0f;
        sine_after[2 * width + k] = rotates ? tau : 0.0f;
        after[p_row + k] = rotates ? pp - change : pp;
        after[q_row + k] = rotates ? qq + change : qq;
        after[next_pq_row + k] = rotates ? 0.0f : pq;
    };
    auto choose_next = [&](int k, const Next& next, int round) {
        const float left = element[next_pq_row + k];
        float pq = left;
        if (blocks > 0) {
            const Block& b = next.between;
            const float s = next.left_sign * sine[b.k], tau = next.left_sign * sine[2 * width + b.k];
            const float s_m = next.right_sign * sine[b.m], tau_m = next.right_sign * sine[2 * width + b.m];
            const float x = old[b.place[0]], right = old[b.place[1]], below = old[b.place[2]], across = old[b.place[3]];
            const float left_p = x - s * (below + tau * x), right_p = right - s * (across + tau * right);
            pq = left_p - s_m * (right_p + tau_m * left_p);
        }
        choose(k, element[next.pp], element[next.qq], pq, round, old, then_sine);
        element[pq_row + k] = left;
    };
    auto rotate_block = [&](int b, const Block& block) {
        const float s = sine[block.k], tau = sine[2 * width + block.k];
        const float s_m = sine[block.m], tau_m = sine[2 * width + block.m];
        const float pp = old[block.place[0]], pq = old[block.place[1]];
        const float qp = old[block.place[2]], qq = old[block.place[3]];
        const float left_p = pp - s * (qp + tau * pp), left_q = qp + s * (pp - tau * qp);
        const float right_p = pq - s * (qq + tau * pq), right_q = qq + s * (pq - tau * qq);
        element[b] = left_p - s_m * (right_p + tau_m * left_p);
        element[blocks + b] = right_p + s_m * (left_p - tau_m * right_p);
        element[2 * blocks + b] = left_q - s_m * (right_q + tau_m * left_q);
        element[3 * blocks + b] = right_q + s_m * (left_q - tau_m * right_q);
    };
    auto rotate_axes = [&](int k, int column, int round) {
        const float s = sine[k], tau = sine[2 * width + k];
        if (s == 0.0f) return;
        ${SEATS}
        float old_p[4], old_q[4];  // all read before any is written: a lane waits for memory once
        for (int c = 0; c < 4; ++c) old_p[c] = p[column + c * quarter], old_q[c] = q[column + c * quarter];
        for (int c = 0; c < 4; ++c) {
            p[column + c * quarter] = old_p[c] - s * (old_q[c] + tau * old_p[c]);
            q[column + c * quarter] = old_q[c] + s * (old_p[c] - tau * old_q[c]);
        }
    };

    const int choosers = 32 * ((pairs + 31) / 32);
    const bool has_workers = lanes > choosers;
    const int worker = has_workers ? lane - choosers : lane, workers = has_workers ? lanes - choosers : lanes;
    const int parts = quarter * pairs;
    const int b = worker < 0 ? blocks : worker;
    const int part = worker < 0 ? parts : workers - 1 - worker;  // first for the lanes without a block
    const int k = part / quarter, column = part - k * quarter;
    Block block;
    Next next;
    if (b < blocks) block = block_at(b, 0);
    if (lane < pairs) {
        next = next_of(lane);
        choose(lane, old[next.pp], old[next.qq], old[moved[pq_row + lane]], 0, element, sine);
    }
    if (lane == 0) spectrum.last_sweep.data[0] = 0.0f;
    __syncthreads();
    int now = 0;
    for (int sweep = 1; sweep <= sweeps; ++sweep) {
        for (int round = 0; round < others; ++round) {
            if (lane < pairs) {
                const bool is_last = round == others - 1;
                if (is_last & large) spectrum.last_sweep.data[0] = sweep;
                if (is_last) large = 0;
                choose_next(lane, next, is_last ? 0 : round + 1);
            }
            if (b < blocks) rotate_block(b, block);
            for (int i = b + workers; i < blocks; i += workers) rotate_block(i, block_at(i, 0));
            if (part < parts) rotate_axes(k, column, round);
            for (int i = part + workers; i < parts; i += workers) rotate_axes(i / quarter, i % quarter, round);
            __syncthreads();
            float* swapped = element; element = old; old = swapped;
            swapped = sine; sine = then_sine; then_sine = swapped;
            now ^= 1;
        }
        // Nobody can write a number below the next sweep's before all lanes have read this.
        if (spectrum.last_sweep.data[0] < sweep) break;
    }
    return now;
#else
    return 0;
#endif
