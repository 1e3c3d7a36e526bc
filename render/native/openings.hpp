// Included by each instruction set in a namespace of its own: what a frame shows inside an eye or a mouth.

void show_through(Array<const i64> corners, Array<const float> weights, Array<const double> head, Array<const u8> roi,
                  double sharpening, Array<float> places, Array<float> own) {
    const i64 h = own.shape[0], w = own.shape[1], n = h * w, line = 3 * w;
    require(own.axes == 3 && own.shape[2] == 3 && own.stride == line, "own must be (h, w, 3)");
    require(corners.shape[1] == n && places.shape[0] == n && places.shape[1] == 2 && places.stride == 2,
            "there must be as many places as pixels");
    mesh_positions(head, corners, weights, places);
    const CubicPicture picture(roi);
    float *seen = memory<101, float>(3 * n + 1), *sums = memory<102, float>(line + 6) + 3;
    for (i64 k = 0; k < n; ++k) picture.read(places.data[2 * k], places.data[2 * k + 1], seen + 3 * k);
    // c + s (c - blurred), blurred by 1 2 1 along both axes
    const float kept = float(1 + sharpening), taken = float(sharpening / 16);
    for (i64 y = 0; y < h; ++y) {
        const float *at = seen + y * line, *above = seen + mirrored(y - 1, h) * line, *below = seen + mirrored(y + 1, h) * line;
        for (i64 k = 0; k < line; ++k) sums[k] = (above[k] + 2 * at[k]) + below[k];
        for (i64 c = 0; c < 3; ++c) {
            sums[c - 3] = sums[3 * mirrored(-1, w) + c];
            sums[line + c] = sums[3 * mirrored(w, w) + c];
        }
        float *out = own.row(y);
        for (i64 k = 0; k < line; ++k) out[k] = kept * at[k] - taken * ((sums[k - 3] + 2 * sums[k]) + sums[k + 3]);
    }
}

void lay_over(Array<const float> own, Array<const float> share, double shown, Array<u8> picture) {
    const i64 h = picture.shape[0], w = picture.shape[1];
    require(picture.axes == 3 && picture.shape[2] == 3, "picture must be (h, w, 3)");
    require(own.axes == 3 && own.shape[0] == h && own.shape[1] == w && own.shape[2] == 3, "own must be as the picture");
    require(share.axes == 2 && share.shape[0] == h && share.shape[1] == w, "share must be (h, w)");
    float *shares = memory<101, float>(3 * w);
    const float scale = float(shown);
    for (i64 y = 0; y < h; ++y) {
        const float *line = share.row(y), *over = own.row(y);
        u8 *at = picture.row(y);
        for (i64 x = 0; x < w; ++x) shares[3 * x] = shares[3 * x + 1] = shares[3 * x + 2] = scale * line[x];
        for (i64 k = 0; k < 3 * w; ++k) {
            const float here = float(at[k]), there = over[k] > 0 ? (over[k] < 255 ? over[k] : 255) : 0;
            at[k] = byte_of(here + shares[k] * (there - here));
        }
    }
}
