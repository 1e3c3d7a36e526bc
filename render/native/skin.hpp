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

// Out (h / 2, w / 2): means of a plane's blocks of four.
inline void halved(const float *plane, i64 h, i64 w, float *out) {
    for (i64 y = 0; y < h / 2; ++y) {
        const float *upper = plane + 2 * y * w, *lower = upper + w;
        for (i64 x = 0; x < w / 2; ++x, ++out) {
            *out = ((upper[2 * x] + upper[2 * x + 1]) + (lower[2 * x] + lower[2 * x + 1])) * 0.25f;
        }
    }
}

// A plane (h, w) blurred in place by a Gaussian: where it is wide, of means of blocks, which are changed by `change`.
struct WideBlur {
    i64 factor = 1;
    double sigma;
    explicit WideBlur(double wide) {
        while (wide >= 2.66 * double(factor) && factor < 64) factor *= 2;
        const double side = double(factor);
        sigma = std::sqrt(wide * wide - (side * side - 1) / 3) / side;  // blocks and stretching blur, too
    }
    template <class F> void run(float *plane, i64 h, i64 w, float *spare, const F &change) const {
        float *from = plane, *to = spare;
        for (i64 k = 1; k < factor; k *= 2, h /= 2, w /= 2, std::swap(from, to)) halved(from, h, w, to);
        gaussian(from, h, w, sigma, from);
        for (i64 k = 0; k < h * w; ++k) from[k] = change(from[k]);
        for (i64 k = 1; k < factor; k *= 2, h *= 2, w *= 2, std::swap(from, to)) doubled(from, h, w, to);
    }
};

// The fine structure of a picture's brightness, without folds and edges.
struct Band {
    Array<const float> plane;
    const float *tiles;  // the most of its values in tiles of so many pixels and in those beside them, whatever their sign
    i64 tiles_down, tiles_across;
    static constexpr i64 TILE = 4;

    Band(Array<const u8> roi, double sigma, double fold) {
        const WideBlur narrow(sigma), wide(2 * sigma);
        const i64 h = roi.shape[0], w = roi.shape[1], side = wide.factor;
        const i64 high = (h + side - 1) / side * side, across = (w + side - 1) / side * side, n = high * across;
        float *band = memory<30, float>(n), *soft = memory<31, float>(n), *spare = memory<34, float>(n);
        for (i64 y = 0; y < high; ++y) {
            const u8 *line = roi.row(mirrored(y, h));
            float *to = band + y * across;
            for (i64 x = 0; x < w; ++x) to[x] = float(line[3 * x]);
            for (i64 x = w; x < across; ++x) to[x] = float(line[3 * mirrored(x, w)]);
        }
        std::copy(band, band + n, soft);
        narrow.run(soft, high, across, spare, [](float value) { return value; });
        for (i64 k = 0; k < n; ++k) band[k] -= soft[k], soft[k] = band[k] * band[k];
        const float rate = float(-0.5 / (fold * fold));
        wide.run(soft, high, across, spare, [rate](float energy) { return std::exp(rate * energy); });
        for (i64 k = 0; k < n; ++k) band[k] *= soft[k];
        plane = {band, {h, w, 1, 1}, 2, across};
        find_tiles();
    }

    void find_tiles() {
        const i64 h = plane.shape[0], w = plane.shape[1];
        tiles_down = (h + TILE - 1) / TILE, tiles_across = (w + TILE - 1) / TILE;
        float *most = memory<37, float>(2 * tiles_down * tiles_across), *made = most + tiles_down * tiles_across;
        std::fill(most, made, 0.0f);
        for (i64 y = 0; y < h; ++y) {
            const float *line = plane.row(y);
            float *to = most + y / TILE * tiles_across;
            for (i64 x = 0; x < w; ++x) to[x / TILE] = std::max(to[x / TILE], std::fabs(line[x]));
        }
        for (i64 y = 0; y < tiles_down; ++y) {
            for (i64 x = 0; x < tiles_across; ++x) made[y * tiles_across + x] = most_of(most, x - 1, y - 1, x + 1, y + 1);
        }
        tiles = made;
    }
    float most_of(const float *of, i64 left, i64 top, i64 right, i64 bottom) const {
        float found = 0;
        for (i64 y = inside(top, tiles_down); y <= inside(bottom, tiles_down); ++y) {
            for (i64 x = inside(left, tiles_across); x <= inside(right, tiles_across); ++x) found = std::max(found, of[y * tiles_across + x]);
        }
        return found;
    }
    static i64 inside(i64 k, i64 size) { return std::min(std::max(k, i64(0)), size - 1); }

    // About the places of a box, given by its least and its largest x and y.
    float most_in(const float *low, const float *high) const {
        const auto tile = [](float at) { return i64(std::min(std::max(at, -8.0f), 1e6f)) / TILE; };
        return most_of(tiles, tile(low[0]), tile(low[1]), tile(high[0]), tile(high[1]));
    }
};

void lay_skin(Array<const u8> roi, Array<const float> cells, Array<const float> share, double sigma, double fold,
              double amount, Array<u8> picture) {
    const i64 h = picture.shape[0], w = picture.shape[1], ch = cells.shape[0], cw = cells.shape[1];
    require(roi.axes == 3 && roi.shape[2] == 3 && roi.size() > 0, "roi must be (h, w, 3)");
    require(cells.shape[2] == 2 && ch > 1 && cw > 1 && cells.stride == 2 * cw, "cells must be (h, w, 2)");
    require(picture.axes == 3 && picture.shape[2] == 3, "picture must be (h, w, 3)");
    require(share.axes == 2 && share.shape[0] == h && share.shape[1] == w, "share must be as the picture");
    require(sigma >= 0.5 && sigma < 1000 && fold > 0, "sigma must be half a pixel at least, and fold positive");
    static const CubicTable table;
    const Band band(roi, sigma, fold);
    const float scale = float(amount);
    float *place = memory<35, float>(2 * cw), *shown = memory<36, float>(w), *most = memory<38, float>(cw);
    Stretch *across = memory<32, Stretch>(w, Stretch(0, 1, 2));
    i64 *starts = memory<39, i64>(cw + 1), row = -1;
    std::fill(starts, starts + cw, w);
    for (i64 x = w - 1; x >= 0; --x) across[x] = Stretch(x, w, cw), starts[across[x].first] = x;
    for (i64 k = cw - 2; k >= 0; --k) starts[k] = std::min(starts[k], starts[k + 1]);
    for (i64 y = 0; y < h; ++y) {
        const Stretch down(y, h, ch);
        const float *upper = cells.row(down.first), *lower = cells.row(down.first + 1), *line = share.row(y);
        if (down.first != row) {
            row = down.first;
            for (i64 k = 0; k + 1 < cw; ++k) {
                float low[2], high[2];
                for (int c = 0; c < 2; ++c) {
                    const float a = upper[2 * k + c], b = upper[2 * k + 2 + c], d = lower[2 * k + c], e = lower[2 * k + 2 + c];
                    low[c] = std::min(std::min(a, b), std::min(d, e)), high[c] = std::max(std::max(a, b), std::max(d, e));
                }
                most[k] = band.most_in(low, high);
            }
        }
        for (i64 k = 0; k < 2 * cw; ++k) place[k] = upper[k] + (lower[k] - upper[k]) * down.share;
        for (i64 x = 0; x < w; ++x) shown[x] = line[x] * scale;
        u8 *out = picture.row(y);
        for (i64 k = 0; k + 1 < cw; ++k) {
            if (!(most[k] * scale > 0.5f)) continue;  // no byte would change
            const float *from = place + 2 * k;
            for (i64 x = starts[k]; x < starts[k + 1]; ++x) {
                if (!(most[k] * shown[x] > 0.5f)) continue;
                const float along = across[x].share;
                const float u = from[0] + (from[2] - from[0]) * along, v = from[1] + (from[3] - from[1]) * along;
                out[3 * x] = byte_of(float(out[3 * x]) + cubic(table, band.plane, u, v) * shown[x]);
            }
        }
    }
}
