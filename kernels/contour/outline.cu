// Native code of outline.py: a section for each function, which Warp puts into the function's body.

// ==== project
    int behind = 0;
    for (int v = lane; v < count; v += lanes) {
        const wp::vec3 world = posed.data[c * count + v];
        const wp::vec3 p = wp::mul(camera.rotation, world) + camera.translation;
        const float share = 1.0f / (p[2] < ${NEAR}f ? ${NEAR}f : p[2]);
        image.data[vertices + v] = wp::vec3(
            camera.lens[0] * p[0] * share + camera.lens[2], camera.lens[1] * p[1] * share + camera.lens[3], p[2]);
        behind += p[2] < ${NEAR}f;
    }
    return behind;

// ==== turns_around
    const float* start_x = line.data + first;
    const float* start_y = start_x + room;
    const float* end_y = start_y + room;
    const float* slope = end_y + room;
    int turns = 0;
    // A band has few lines: vectors under a mask spare the remainder that is counted one by one.
#if defined(__AVX2__)
    #pragma clang loop vectorize_width(16) interleave_count(1) vectorize_predicate(enable)
#endif
    for (int i = begin; i < end; ++i)
        turns += ((start_y[i] <= y) - (end_y[i] <= y)) * (start_x[i] + (y - start_y[i]) * slope[i] < x);
    return turns;

// ==== face_camera
    for (int f = lane; f < face.shape[0]; f += lanes) {
        const wp::vec3 a = image.data[vertices + face.data[f][0]];
        const wp::vec3 b = image.data[vertices + face.data[f][1]];
        const wp::vec3 c = image.data[vertices + face.data[f][2]];
        facing.data[faces + f] = (b[0] - a[0]) * (c[1] - a[1]) - (b[1] - a[1]) * (c[0] - a[0]) < 0.0f;
    }

// ==== find_share
    int count = 0;
    for (int i = first; i < end; ++i) {
        const int left = facing.data[faces + edge.data[i][2]];
        found.data[edges + first + count] = left ? i : -1 - i;
        count += left != facing.data[faces + edge.data[i][3]];
    }
    return count;
