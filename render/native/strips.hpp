// Included by each instruction set in a namespace of its own: strips about brows.

// A column's pixel (4,) between four rows, by cubic convolution: beyond the second by a share.
inline F4 between_rows(const u8 *const *rows, i64 at, float share) {
    const float s = share, t = 1 - share;
    const F4 a(((-0.75f * s + 1.5f) * s - 0.75f) * s), b((1.25f * s - 2.25f) * s * s + 1);
    const F4 c((1.25f * t - 2.25f) * t * t + 1), d(((-0.75f * t + 1.5f) * t - 0.75f) * t);
    const F4 upper = a * F4::of_bytes(rows[0] + at) + b * F4::of_bytes(rows[1] + at);
    return upper + (c * F4::of_bytes(rows[2] + at) + d * F4::of_bytes(rows[3] + at));
}

// Out (factor w,): a row y of a plane (h, w) that is enlarged bilinearly, as at its border beyond it.
inline void enlarge_row(const float *plane, i64 h, i64 w, i64 factor, i64 y, float *line, float *out) {
    const float step = 1 / float(factor), v = (float(y) + 0.5f) * step - 0.5f, below = std::max(v, 0.0f);
    const i64 top = i64(below), next = std::min(top + 1, h - 1);
    const float *one = plane + top * w, *other = plane + next * w, down = below - float(top);
    for (i64 x = 0; x < w; ++x) line[x] = one[x] + (other[x] - one[x]) * down;
    for (i64 k = 0; k < factor; ++k) {
        const float u = (float(k) + 0.5f) * step - 0.5f;  // of the pixel before it in the first half
        const float *from = line + (u < 0 ? -1 : 0), share = u < 0 ? u + 1 : u;
        line[-1] = line[0], line[w] = line[w - 1];
        for (i64 x = 0; x < w; ++x) out[factor * x + k] = from[x] + (from[x + 1] - from[x]) * share;
    }
}

void keep_brow(Array<const i64> corners, Array<const float> weights, Array<const i64> end_corners,
               Array<const float> end_weights, Array<const double> drawn, Array<const double> at_rest,
               Array<const float> heights, Array<const float> columns, Array<const double> limits, i64 top, i64 factor,
               Array<u8> picture) {
    const i64 h = heights.shape[0], w = heights.shape[1], points = drawn.shape[0], high = picture.shape[0];
    require(drawn.axes == 2 && drawn.shape[1] == 2 && drawn.stride == 2, "drawn must be (p, 2)");
    require(at_rest.axes == 2 && at_rest.shape[0] == points && at_rest.shape[1] == 2 && at_rest.stride == 2,
            "at_rest must be as drawn");
    require(heights.axes == 2 && heights.stride == w && h > 0 && w > 0, "heights must be (h, w)");
    require(columns.axes == 2 && columns.shape[0] == 4 && columns.shape[1] == w && columns.stride == w, "columns must be (4, w)");
    require(limits.axes == 1 && limits.shape[0] == 5 && limits.stride == 1, "there must be 5 limits");
    require(picture.axes == 3 && picture.shape[2] == 3 && factor > 0 && picture.shape[1] == factor * w && high > 0 && top >= 0 &&
                top + factor * h <= high && high < (1 << 24),
            "the strip must lie in the picture (y, factor w, 3)");
    const Mesh inside(corners, weights, points), ends(end_corners, end_weights, points);
    require(inside.places == h * w && ends.places == 2 * w, "there must be as many places as pixels, and ends as columns");
    const float least = float(limits.data[0]), unchanged = float(limits.data[1]), lowest = float(limits.data[4]);
    const float low = float(limits.data[2] - 1), high_stretch = float(limits.data[3] - 1);

    // How far each column is stretched, and by how much less it is to be.
    const float *rest = floats<120>(at_rest.data, 2 * points);
    double *moves = memory<121, double>(2 * points);
    for (i64 k = 0; k < 2 * points; ++k) moves[k] = drawn.data[k] - at_rest.data[k];
    const float *moved = floats<122>(moves, 2 * points);
    float *end_rest = memory<123, float>(4 * w), *end_moved = memory<124, float>(4 * w);
    ends.lay(rest, end_rest);
    ends.lay(moved, end_moved);
    const float *line = columns.data, *whole = line + w, *hair = whole + w, *shown = hair + w;
    float *gap = memory<125, float>(6 * w), *share = gap + w, *lid = share + w, *end = lid + w, *above = end + w, *below = above + w;
    float most = 0;
    for (i64 x = 0; x < w; ++x) {
        gap[x] = std::max(end_rest[2 * (w + x) + 1] - end_rest[2 * x + 1], least);
        const float stretch = (end_moved[2 * (w + x) + 1] - end_moved[2 * x + 1]) / gap[x];
        most = std::max(most, std::fabs(stretch));
        const float limited = std::min(std::max(stretch, low), high_stretch);
        share[x] = shown[x] * limited / (stretch + (stretch == 0 ? 1 : 0));
        lid[x] = 1 + shown[x] * limited;
        end[x] = std::min(hair[x], lowest * lid[x]);
        above[x] = hair[x] / end[x];
        below[x] = (1 - hair[x]) / (lid[x] - end[x]);
    }
    if (most < unchanged) return;

    // The rows of the picture that are read.
    float *places = memory<126, float>(2 * h * w), *rows = memory<127, float>(h * w);
    inside.lay(moved, places);
    for (i64 y = 0; y < h; ++y) {
        const float *at = heights.row(y), *place = places + 2 * y * w;
        float *row = rows + y * w;
        for (i64 x = 0; x < w; ++x) {
            const float height = at[x] + (place[2 * x + 1] - end_moved[2 * x + 1]) / gap[x] * share[x];
            const float changed = height < end[x] ? height * above[x] : hair[x] + (height - end[x]) * below[x];
            const float read = at[x] > 0 && at[x] < 1 ? changed : at[x];
            row[x] = (line[x] + whole[x] * read + 0.5f) * float(factor) - 0.5f;
        }
    }
    const i64 width = factor * w;
    u8 *kept = memory<128, u8>(3 * width * high + 1);
    for (i64 y = 0; y < high; ++y) std::memcpy(kept + 3 * width * y, picture.row(y), std::size_t(3 * width));
    const auto held = [=](i64 k) { return kept + 3 * width * (k < 0 ? 0 : k >= high ? high - 1 : k); };
    float *read = memory<129, float>(w + 2 + width), *row = read + w + 2;
    for (i64 y = 0; y < factor * h; ++y) {
        u8 *out = picture.row(top + y);
        enlarge_row(rows, h, w, factor, y, read + 1, row);
        for (i64 x = 0; x < width; ++x) {
            if (std::fabs(row[x] - float(top + y)) < 1e-4f) continue;
            const float bounded = row[x] > -3 ? (row[x] < float(high + 2) ? row[x] : float(high + 2)) : -3;
            const float first = std::floor(bounded);
            const i64 upper = i64(first);
            const u8 *lines[] = {held(upper - 1), held(upper), held(upper + 1), held(upper + 2)};
            const std::uint32_t word = between_rows(lines, 3 * x, bounded - first).bytes();
            std::memcpy(out + 3 * x, &word, 3);
        }
    }
}

// How alike bands of rows are, at every shift: correlations (k,) of one at rest (h, w) with parts of one that is seen,
// (h + k - 1, w) whole numbers from 0 to 255.
inline void correlate(Array<const float> at_rest, const float *seen, i64 shifts, double *alike) {
    const i64 h = at_rest.shape[0], w = at_rest.shape[1], rows = h + shifts - 1, n = h * w;
    float *apart = memory<130, float>(n);
    const float middle = sum(at_rest.data, n) / float(n);
    for (i64 k = 0; k < n; ++k) apart[k] = at_rest.data[k] - middle;
    const double rest = double(dot(apart, apart, n));
    double *sums = memory<131, double>(2 * rows), *squares = sums + rows;
    for (i64 y = 0; y < rows; ++y) {
        sums[y] = double(sum(seen + y * w, w));
        squares[y] = double(dot(seen + y * w, seen + y * w, w));
    }
    for (i64 k = 0; k < shifts; ++k) {
        double total = 0, square = 0, both = 0;
        for (i64 y = 0; y < h; ++y) {
            total += sums[k + y], square += squares[k + y];
            both += double(dot(apart + y * w, seen + (k + y) * w, w));
        }
        const double spread = std::sqrt(std::max(square - total * total / double(n), 0.0) * rest);
        alike[k] = spread > 1e-6 ? both / spread : 0;
    }
}

void brow_shifts(Array<const i64> corners, Array<const float> weights, Array<const double> shape, Array<const u8> luma,
                 Array<const float> right, Array<const float> left, Array<const double> limits, Array<const double> costs,
                 Array<double> found) {
    require(shape.axes == 2 && shape.shape[1] == 2 && shape.stride == 2, "shape must be (p, 2)");
    require(luma.axes == 2 && luma.size() > 0 && luma.shape[0] < (1 << 24) && luma.shape[1] < (1 << 24), "luma must be (h, w)");
    require(costs.axes == 1 && costs.stride == 1 && limits.axes == 1 && limits.shape[0] == 3 && limits.stride == 1 &&
                found.axes == 1 && found.shape[0] == 2 && found.stride == 1,
            "costs must be (k,), limits (3,), and found (2,)");
    const Mesh mesh(corners, weights, shape.shape[0]);
    const i64 shifts = costs.shape[0];
    float *places = memory<132, float>(2 * mesh.places), *seen = memory<133, float>(mesh.places);
    mesh.lay(floats<134>(shape.data, shape.size()), places);
    const Plane<u8> plane{luma.data, luma.shape[1], luma.shape[0], luma.stride};
    for (i64 k = 0; k < mesh.places; ++k) seen[k] = float(nearest(plane.at(places[2 * k], places[2 * k + 1])));
    double *alike = memory<135, double>(shifts);
    const double row = limits.data[0], first = limits.data[1], last = limits.data[2];
    i64 begun = 0;
    const Array<const float> bands[] = {right, left};
    for (int side = 0; side < 2; ++side) {
        const Array<const float> &band = bands[side];
        require(band.axes == 2 && band.size() > 0 && (band.stride == band.shape[1] || band.shape[0] == 1), "a band must be (h, w)");
        const i64 size = (band.shape[0] + shifts - 1) * band.shape[1];
        require(shifts > 0 && begun + size <= mesh.places, "there must be as many places as pixels of the bands");
        correlate(band, seen + begun, shifts, alike);
        begun += size;
        i64 best = 0;
        for (i64 k = 1; k < shifts; ++k) {
            if (alike[k] - costs.data[k] > alike[best] - costs.data[best]) best = k;
        }
        double peak = row * double(best - (shifts - 1) / 2);
        if (best > 0 && best < shifts - 1) {
            const double before = alike[best - 1] - costs.data[best - 1], here = alike[best] - costs.data[best];
            const double after = alike[best + 1] - costs.data[best + 1];
            peak += row * ((before - after) / (2 * std::min(before - 2 * here + after, -1e-6)));
        }
        found.data[side] = peak * std::min(std::max((alike[best] - first) / (last - first), 0.0), 1.0);
    }
}

// Which cell a pixel of an axis lies in when its pixels are shared among fewer cells, and its share in it; the next has the rest.
struct Shared {
    i64 *cell;
    float *share;
    Shared(i64 pixels, i64 cells, i64 *cell, float *share) : cell(cell), share(share) {
        const double size = double(pixels) / double(cells);
        for (i64 k = 0; k < pixels; ++k) {
            cell[k] = std::min(i64(double(k) / size), cells - 1);
            share[k] = float(std::min(std::max(double(cell[k] + 1) * size - double(k), 0.0), 1.0));
        }
    }
};

// Paint over brows with the colours of the skin beside them; planes (h, w) of cells are computed from them and the part.
void paint_over(Array<const float> brows, Array<const float> skin, Array<const double> numbers, Array<u8> part) {
    const i64 h = brows.shape[0], w = brows.shape[1], n = h * w, high = part.shape[0], wide = part.shape[1];
    require(part.axes == 3 && part.shape[2] == 3 && part.size() > 0, "part must be (y, x, 3)");
    require(brows.axes == 2 && n > 0 && h <= high && w <= wide && (brows.stride == w || h == 1), "brows must be (h, w)");
    require(skin.axes == 2 && skin.shape[0] == h && skin.shape[1] == w && (skin.stride == w || h == 1), "skin must be as brows");
    require(numbers.axes == 1 && numbers.stride == 1 && numbers.shape[0] == 8, "there must be 8 numbers");
    const double *told = numbers.data;
    const i64 reach = i64(told[0]);
    require(reach >= 0 && reach < 1000 && told[1] > 0 && told[1] < 1000, "lengths must be positive, and not many cells");

    // Brows grown by so many cells, and softened.
    float *grown = memory<150, float>(8 * n), *across = grown + n, *weight = across + n, *known = weight + n, *beside = known + n;
    for (i64 y = 0; y < h; ++y) {
        for (i64 x = 0; x < w; ++x) {
            float most = brows.data[y * w + x];
            for (i64 k = std::max(x - reach, i64(0)); k <= std::min(x + reach, w - 1); ++k) most = std::max(most, brows.data[y * w + k]);
            across[y * w + x] = most;
        }
    }
    for (i64 y = 0; y < h; ++y) {
        float *out = grown + y * w;
        std::copy(across + y * w, across + (y + 1) * w, out);
        for (i64 k = std::max(y - reach, i64(0)); k <= std::min(y + reach, h - 1); ++k) {
            for (i64 x = 0; x < w; ++x) out[x] = std::max(out[x], across[k * w + x]);
        }
    }
    gaussian(grown, h, w, double(2 * reach + 1) / 4, grown);

    // Means of the part in the cells, and of the skin beside each.
    const Shared columns(wide, w, memory<151, i64>(wide), memory<152, float>(wide));
    const Shared rows(high, h, memory<153, i64>(high), memory<154, float>(high));
    float *line = memory<155, float>(4 * (w + 1));
    u8 *kept = memory<160, u8>(3 * wide + 1);
    std::fill(beside, beside + 3 * n, 0.0f);
    for (i64 y = 0; y < high; ++y) {
        std::fill(line, line + 4 * (w + 1), 0.0f);
        std::memcpy(kept, part.row(y), std::size_t(3 * wide));
        for (i64 x = 0; x < wide; ++x) {
            const F4 value = F4::of_bytes(kept + 3 * x), here = value * F4(columns.share[x]);
            float *out = line + 4 * columns.cell[x];
            (F4::load(out) + here).store(out);
            if (columns.share[x] < 1) (F4::load(out + 4) + (value - here)).store(out + 4);
        }
        for (i64 next = 0; next < 2; ++next) {
            const i64 row = rows.cell[y] + next;
            const float share = next ? 1 - rows.share[y] : rows.share[y];
            if (row >= h || share == 0) continue;
            for (int c = 0; c < 3; ++c) {
                float *out = beside + c * n + row * w;
                for (i64 x = 0; x < w; ++x) out[x] += share * line[4 * x + c];
            }
        }
    }
    const float area = float(double(n) / (double(high) * double(wide)));
    for (i64 k = 0; k < n; ++k) {
        weight[k] = ramp(skin.data[k], told[4], told[5]) * (1 - ramp(grown[k], told[2], told[3]));
        for (int c = 0; c < 3; ++c) beside[c * n + k] *= area * weight[k];
    }
    gaussian(weight, h, w, told[1], known);
    for (int c = 0; c < 3; ++c) gaussian(beside + c * n, h, w, told[1], beside + c * n);
    float *paint = memory<156, float>(4 * n);  // colour, and share
    for (i64 k = 0; k < n; ++k) {
        const float divisor = std::max(known[k], 1e-6f);
        for (int c = 0; c < 3; ++c) paint[4 * k + c] = beside[c * n + k] / divisor;
        paint[4 * k + 3] = grown[k] * ramp(known[k], told[6], told[7]);
    }

    // Enlarged, and blended.
    i64 *left = memory<157, i64>(wide);
    float *right = memory<158, float>(wide), *between = memory<159, float>(4 * (w + 1));
    const double step_x = double(w) / double(wide), step_y = double(h) / double(high);
    for (i64 x = 0; x < wide; ++x) {
        const double u = std::min(std::max((double(x) + 0.5) * step_x - 0.5, 0.0), double(w - 1));
        left[x] = i64(u);
        right[x] = float(u - double(left[x]));
    }
    for (i64 y = 0; y < high; ++y) {
        const double v = std::min(std::max((double(y) + 0.5) * step_y - 0.5, 0.0), double(h - 1));
        const i64 top = i64(v), next = std::min(top + 1, h - 1);
        const float down = float(v - double(top)), *one = paint + 4 * top * w, *other = paint + 4 * next * w;
        for (i64 k = 0; k < 4 * w; ++k) between[k] = one[k] + (other[k] - one[k]) * down;
        for (i64 k = 0; k < 4; ++k) between[4 * w + k] = between[4 * (w - 1) + k];
        u8 *out = part.row(y);
        std::memcpy(kept, out, std::size_t(3 * wide));
        for (i64 x = 0; x < wide; ++x) {
            const float *at = between + 4 * left[x];
            if (at[3] == 0 && at[7] == 0) continue;
            const F4 first = F4::load(at), there = first + (F4::load(at + 4) - first) * F4(right[x]);
            const F4 here = F4::of_bytes(kept + 3 * x);
            const std::uint32_t word = (here + there.all<3>() * (there - here)).bytes();
            std::memcpy(out + 3 * x, &word, 3);
        }
    }
}
