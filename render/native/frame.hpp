// Included by each instruction set in a namespace of its own: planes of a video's frame.

void merge_planes(Array<const u8> luma, Array<const u8> u, Array<const u8> v, i64 shift_x, i64 shift_y, i64 left,
                  i64 top, Array<u8> out) {
    const i64 h = luma.shape[0], w = luma.shape[1];
    require(out.shape[0] == h && out.shape[1] == w && out.shape[2] == 3, "out must be (h, w, 3)");
    require(shift_x >= 0 && shift_x < 8 && shift_y >= 0 && shift_y < 8 && left >= 0 && top >= 0, "no such cells");
    for (const Array<const u8> *plane : {&u, &v}) {
        require(((top + h - 1) >> shift_y) < plane->shape[0] && ((left + w - 1) >> shift_x) < plane->shape[1],
                "chroma must cover luma");
    }
    for (i64 y = 0; y < h; ++y) {
        const u8 *bright = luma.row(y), *blue = u.row((top + y) >> shift_y), *red = v.row((top + y) >> shift_y);
        u8 *made = out.row(y);
        for (i64 x = 0; x < w; ++x) {
            const i64 cell = (left + x) >> shift_x;
            made[3 * x] = bright[x];
            made[3 * x + 1] = blue[cell];
            made[3 * x + 2] = red[cell];
        }
    }
}
