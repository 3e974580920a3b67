// Native code of outline.py: a section for each function, which Warp puts into the function's body.

// ==== project
    int behind = 0;
    const int count = posed.shape[1];
    wp::vec3* image = outline.image.data + (c * outline.count.shape[1] + k) * count;
    for (int v = lane; v < count; v += lanes) {
        const wp::vec3 world = posed.data[c * count + v];
        const wp::vec3 p = wp::mul(camera.rotation, world) + camera.translation;
        const float share = 1.0f / (p[2] < ${NEAR}f ? ${NEAR}f : p[2]);
        image[v] = wp::vec3(
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
    for (int i = begin; i < end; ++i)
        turns += ((start_y[i] <= y) - (end_y[i] <= y)) * (start_x[i] + (y - start_y[i]) * slope[i] < x);
    return turns;

// ==== band_of
    const auto band_of = [&](float y) {  // as in outline.py: what meets is in one band only if all say so alike
        const float band = y * bands / rows;
        return band < 0.0f ? 0 : band < bands - 1.0f ? (int)band : (int)bands - 1;
    };

// ==== on_outline
    int number = 0;
#if !defined(__CUDA_ARCH__)
    // Probes of a band meet the same lines: sorted by bands, a vector of them goes from line to line.
    constexpr int most = 512, wide = 16;
    typedef float Floats __attribute__((ext_vector_type(wide), aligned(4)));
    typedef int Ints __attribute__((ext_vector_type(wide)));
    const int view = c * outline.count.shape[1] + k, count = outline.count.data[view], room = outline.room;
    const wp::vec2i* edge = outline.ends.data + view * outline.ends.shape[2];
    const wp::vec3* place = outline.image.data + view * outline.image.shape[2];
    const int* start = outline.band.data + view * (${BANDS} + 1);
    const float *start_x = outline.line.data + view * 4 * room, *start_y = start_x + room, *end_y = start_y + room;
    const float *slope = end_y + room, bands = ${BANDS}, rows = image[1], right = image[0] - 1, bottom = image[1] - 1;
    int* kept = outline.found.data + view * outline.found.shape[2];
${band_of}
    for (int from = 0; from < count; from += most) {
        const int some = count - from < most ? count - from : most;
        float probe_x[most], probe_y[most], x[most + wide], y[most + wide];
        int in[most], of[most + wide], next[${BANDS} + 2] = {};
        for (int i = 0; i < some; ++i) {
            // Warp's functions fuse no product with a sum: they give the bits of edges that are judged one by one.
            const wp::vec3 a = place[edge[from + i][0]], b = place[edge[from + i][1]];
            const wp::vec2 along(b[0] - a[0], b[1] - a[1]), middle(0.5f * (a[0] + b[0]), 0.5f * (a[1] + b[1]));
            const float length = wp::length(along);
            const wp::vec2 out = wp::mul(${PROBE}f, wp::div(wp::vec2(-along[1], along[0]), length));
            const wp::vec2 probe = wp::add(middle, out);
            const bool usable = length > 1.0e-6f && middle[0] > rim && middle[1] > rim && middle[0] < right - rim
                && middle[1] < bottom - rim;
            probe_x[i] = probe[0];
            probe_y[i] = probe[1];
            in[i] = usable ? band_of(probe[1]) : ${BANDS};
        }
        for (int i = 0; i < some; ++i)
            ++next[in[i] + 1];
        for (int b = 0; b < ${BANDS}; ++b)
            next[b + 1] += next[b];
        for (int i = 0; i < some; ++i) {
            const int at = next[in[i]]++;
            x[at] = probe_x[i];
            y[at] = probe_y[i];
            of[at] = i;
        }
        // Now ``next`` has where each band's probes end.
        for (int b = 0, first = 0; b < ${BANDS}; first = next[b++]) {
            const bool sorted = start[b] <= start[b + 1];
            const int begin = sorted ? start[b] : 0, end = sorted ? start[b + 1] : count;
            for (int i = first; i < next[b]; i += wide) {
                const Floats px = *(const Floats*)(x + i), py = *(const Floats*)(y + i);
                Ints turns = 0;
                for (int l = begin; l < end; ++l)
                    turns += ((end_y[l] <= py) - (start_y[l] <= py)) & (start_x[l] + (py - start_y[l]) * slope[l] < px);
                for (int lane = 0; lane < wide && i + lane < next[b]; ++lane)
                    in[of[i + lane]] = turns[lane] == 0 ? 0 : ${BANDS};
            }
        }
        for (int i = 0; i < some; ++i) {
            kept[number] = from + i;
            number += in[i] < ${BANDS};
        }
    }
#endif
    return number;

// ==== face_camera
    const int view = c * outline.count.shape[1] + k;
    const wp::vec3* image = outline.image.data + view * outline.image.shape[2];
    wp::uint8* facing = outline.facing.data + view * face.shape[0];
    for (int f = lane; f < face.shape[0]; f += lanes) {
        const wp::vec3 a = image[face.data[f][0]];
        const wp::vec3 b = image[face.data[f][1]];
        const wp::vec3 c = image[face.data[f][2]];
        facing[f] = (b[0] - a[0]) * (c[1] - a[1]) - (b[1] - a[1]) * (c[0] - a[0]) < 0.0f;
    }

// ==== find_share
    const int view = c * outline.count.shape[1] + k;
    const wp::uint8* facing = outline.facing.data + view * outline.facing.shape[2];
    int count = 0, *found = outline.found.data + view * edge.shape[0];
    for (int i = first; i < end; ++i) {
        const int left = facing[edge.data[i][2]];
        found[first + count] = left ? i : -1 - i;
        count += left != facing[edge.data[i][3]];
    }
    return count;

// ==== sort_lines
#if !defined(__CUDA_ARCH__)
    const int view = c * outline.count.shape[1] + k, room = outline.room;
    const float bands = ${BANDS}, rows = height;
    int* begin = outline.band.data + view * (${BANDS} + 1);
    int* reach = outline.found.data + view * outline.found.shape[2];  // bands: ``ends`` has the edges
    const wp::vec2i* end = outline.ends.data + view * outline.ends.shape[2];
    const wp::vec3* place = outline.image.data + view * outline.image.shape[2];
${band_of}
    for (int s = 0; s < count; ++s) {
        const int one = band_of(place[end[s][0]][1]), other = band_of(place[end[s][1]][1]);
        reach[s] = one < other ? one | other << 16 : other | one << 16;
    }
    int next[${BANDS}] = {}, total = 0;
    for (int s = 0; s < count; ++s)
        for (int b = reach[s] & 0xffff; b <= reach[s] >> 16; ++b)
            ++next[b];
    for (int b = 0; b < ${BANDS}; ++b) {
        begin[b] = total;
        total += next[b];
        next[b] = begin[b];
    }
    begin[${BANDS}] = total;
    const bool fits = total <= room;
    if (!fits)
        for (int b = 0; b <= ${BANDS}; ++b)
            begin[b] = b < ${BANDS} ? ${BANDS} - b : 0;
    float* start_x = outline.line.data + view * 4 * room;
    float *start_y = start_x + room, *end_y = start_y + room, *slope = end_y + room;
    for (int s = 0; s < count; ++s) {
        const wp::vec3 a = place[end[s][0]], b = place[end[s][1]];
        const float rise = b[1] - a[1];
        const float inclined = rise == 0.0f ? 0.0f : (b[0] - a[0]) / rise;
        const int first = fits ? reach[s] & 0xffff : 0, last = fits ? reach[s] >> 16 : 0;
        for (int n = first; n <= last; ++n) {
            const int at = fits ? next[n]++ : s;
            start_x[at] = a[0];
            start_y[at] = a[1];
            end_y[at] = b[1];
            slope[at] = inclined;
        }
    }
#endif
