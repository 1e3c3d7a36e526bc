// Included by each instruction set in a namespace of its own: the frame's own structure in the texture.

// Places of an axis of `count` pixels between `cells` that are stretched over it, as of cv2.resize.
struct Stretch {
    i32 first;
    float share;
    Stretch(i64 x, i64 count, i64 cells) {
        const float scale = float(double(cells) / double(count));
        const float at = std::min(std::max((float(x) + 0.5f) * scale - 0.5f, 0.0f), float(cells - 1));
        first = std::max(std::min(i32(at), i32(cells) - 2), 0);
        share = at - float(first);
    }
};

// Weights of four neighbours, cubic (A = -0.75), at so many steps of a pixel behind the second.
constexpr int STEPS = 64;
struct CubicTable {
    float weights[STEPS][4];
    CubicTable() {
        for (int k = 0; k < STEPS; ++k) {
            const float x = float(k) / STEPS, a = -0.75f;
            float *w = weights[k];
            w[0] = ((a * (x + 1) - 5 * a) * (x + 1) + 8 * a) * (x + 1) - 4 * a;
            w[1] = ((a + 2) * x - (a + 3)) * x * x + 1;
            w[2] = ((a + 2) * (1 - x) - (a + 3)) * (1 - x) * (1 - x) + 1;
            w[3] = 1 - w[0] - w[1] - w[2];
        }
    }
};

inline float cubic(const CubicTable &table, Array<const float> band, float u, float v) {
    const i64 h = band.shape[0], w = band.shape[1];
    u = std::min(std::max(u, -8.0f), float(w + 8));
    v = std::min(std::max(v, -8.0f), float(h + 8));
    const i64 su = nearest(u * STEPS), sv = nearest(v * STEPS), x = (su >> 6) - 1, y = (sv >> 6) - 1;
    const float *wx = table.weights[su & (STEPS - 1)], *wy = table.weights[sv & (STEPS - 1)];
    float corner[16];
    const bool inside = x >= 0 && y >= 0 && x + 4 <= w && y + 4 <= h;
    if (!inside) {
        for (i64 j = 0; j < 4; ++j) {
            const float *row = band.row(std::min(std::max(y + j, i64(0)), h - 1));
            for (i64 i = 0; i < 4; ++i) corner[4 * j + i] = row[std::min(std::max(x + i, i64(0)), w - 1)];
        }
    }
    const float *at = inside ? band.row(y) + x : corner;
    const i64 step = inside ? band.stride : 4;
    F4 sum = F4::load(at) * F4(wy[0]);
    for (int j = 1; j < 4; ++j) sum = sum + F4::load(at + j * step) * F4(wy[j]);
    float part[4];
    (sum * F4::load(wx)).store(part);
    return (part[0] + part[1]) + (part[2] + part[3]);
}

void lay_band(Array<const float> band, Array<const float> cells, Array<const float> share, double amount,
              Array<u8> picture) {
    const i64 h = picture.shape[0], w = picture.shape[1], ch = cells.shape[0], cw = cells.shape[1];
    const i64 sh = share.shape[0], sw = share.shape[1];
    require(band.axes == 2 && band.size() > 0 && share.axes == 2 && share.size() > 0, "band and share must be (h, w)");
    require(cells.shape[2] == 2 && ch > 1 && cw > 1 && cells.stride == 2 * cw, "cells must be (h, w, 2)");
    require(sh > 1 && sw > 1, "share must have two rows");
    require(picture.shape[2] == 3, "picture must be (h, w, 3)");
    static const CubicTable table;
    constexpr float LEAST = 1e-3f;  // of a grey level in a few hundreds
    float *place = memory<30, float>(2 * cw), *shown = memory<31, float>(sw);
    Stretch *across = memory<32, Stretch>(2 * w, Stretch(0, 1, 2));
    for (i64 x = 0; x < w; ++x) {
        across[x] = Stretch(x, w, cw);
        across[w + x] = Stretch(x, w, sw);
    }
    const float whole = float(amount);
    for (i64 y = 0; y < h; ++y) {
        const Stretch down(y, h, ch), below(y, h, sh);
        const float *upper = cells.row(down.first), *lower = cells.row(down.first + 1);
        for (i64 k = 0; k < 2 * cw; ++k) place[k] = upper[k] + (lower[k] - upper[k]) * down.share;
        const float *more = share.row(below.first), *less = share.row(below.first + 1);
        for (i64 k = 0; k < sw; ++k) shown[k] = (more[k] + (less[k] - more[k]) * below.share) * whole;
        u8 *out = picture.row(y);
        for (i64 x = 0; x < w; ++x) {
            const Stretch beside = across[w + x], at = across[x];
            const float of = shown[beside.first] + (shown[beside.first + 1] - shown[beside.first]) * beside.share;
            if (!(of > LEAST)) continue;
            const float *from = place + 2 * at.first;
            const float u = from[0] + (from[2] - from[0]) * at.share, v = from[1] + (from[3] - from[1]) * at.share;
            out[3 * x] = byte_of(float(out[3 * x]) + cubic(table, band, u, v) * of);
        }
    }
}
