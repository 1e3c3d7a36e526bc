// Included by each instruction set in a namespace of its own: a person's tracker.

// Parts of the working crop of a picture: means over whole blocks, then bilinear, both rounded, as OpenCV computes them.
struct GreyCrop {
    Plane<u8> part;  // of the picture
    i64 whole;       // pixels of it in a block's side
    i64 width, height;
    double corner_x, corner_y, scale_x, scale_y;

    struct Axis {  // of a pixel of the crop: the blocks that it lies between, and shares of 2048 of each
        i64 first, second;
        int near, far;
    };
    static Axis axis(i64 place, i64 size, i64 blocks) {
        const float at = float((double(place) + 0.5) * (1 / (double(size) / double(blocks))) - 0.5);
        i64 first = Plane<u8>::floored(at);
        float share = at - float(first);
        if (first < 0) first = 0, share = 0;
        if (first >= blocks - 1) first = blocks - 1, share = 0;
        return {first, std::min(first + 1, blocks - 1), int(std::lrint((1 - share) * 2048)), int(std::lrint(share * 2048))};
    }

    struct Box {
        i64 x0, y0, x1, y1;
        bool holds(Box other) const { return x0 <= other.x0 && y0 <= other.y0 && x1 >= other.x1 && y1 >= other.y1; }
    };
    u8 *pixels = nullptr;  // (height, width), made where `made` says
    Box made{0, 0, 0, 0};
    std::uint32_t *sums = nullptr;  // of a row's pixels over a block's height
    u8 *blocks = nullptr;           // of a row

    // The pixels about those points (x, y) of the crop that lie in it.
    Plane<u8> about(const float *points, i64 count) {
        float low_x = float(width), low_y = float(height), high_x = -1, high_y = -1;
        for (i64 k = 0; k < count; ++k) {
            const float x = Plane<u8>::near(points[2 * k], width), y = Plane<u8>::near(points[2 * k + 1], height);
            low_x = std::min(low_x, x), high_x = std::max(high_x, x);
            low_y = std::min(low_y, y), high_y = std::max(high_y, y);
        }
        const auto clipped = [](float place, i64 beyond, i64 size) { return Plane<u8>::inside(i64(place) + beyond, size); };
        const Box needed{clipped(low_x, -1, width), clipped(low_y, -1, height), clipped(high_x, 1, width) + 1, clipped(high_y, 1, height) + 1};
        if (!made.holds(needed)) make(needed);
        return {pixels, width, height, width};
    }

    void make(Box box) {
        const i64 margin = made.x1 ? width : 4;  // a face that moves far is rare
        made = {std::max<i64>(box.x0 - margin, 0), std::max<i64>(box.y0 - margin, 0), std::min(box.x1 + margin, width), std::min(box.y1 + margin, height)};
        pixels = memory<210, u8>(width * height), blocks = memory<215, u8>(part.width), sums = memory<214, std::uint32_t>(part.width);
        const i64 across = part.width / whole, down = part.height / whole;
        Axis *columns = memory<211, Axis>(width);
        for (i64 x = made.x0; x < made.x1; ++x) columns[x] = axis(x, width, across);
        const i64 first = columns[made.x0].first, last = columns[made.x1 - 1].second + 1;
        int *rows[2] = {memory<212, int>(width), memory<213, int>(width)};
        i64 known[2] = {-1, -1};
        for (i64 y = made.y0; y < made.y1; ++y) {
            const Axis line = axis(y, height, down);
            for (int k = 0; k < 2; ++k) {
                const i64 row = k ? line.second : line.first;
                if (known[k] == row) continue;
                if (!k && known[1] == row) {
                    std::swap(rows[0], rows[1]), std::swap(known[0], known[1]);
                    continue;
                }
                spread(averaged(row, first, last), columns + made.x0, made.x1 - made.x0, rows[k] + made.x0);
                known[k] = row;
            }
            blend(rows[0] + made.x0, rows[1] + made.x0, line.near, line.far, made.x1 - made.x0, pixels + y * width + made.x0);
        }
    }
    // Means of a row's blocks, from a first one to before a last one.
    const u8 *averaged(i64 row, i64 first, i64 last) {
        if (whole == 1) return part.data + row * part.stride;
        const i64 start = first * whole, count = (last - first) * whole;
        std::fill(sums, sums + count, 0u);
        for (i64 k = 0; k < whole; ++k) {
            const u8 *from = part.data + (row * whole + k) * part.stride + start;
            for (i64 x = 0; x < count; ++x) sums[x] += from[x];
        }
        const std::uint32_t *from = sums;
        if (whole == 2) {
            u8 *out = blocks + first;
            for (i64 x = 0; x < last - first; ++x) out[x] = u8((from[2 * x] + from[2 * x + 1] + 2) >> 2);
            return blocks;
        }
        const float over = float(1 / double(whole * whole));
        for (i64 x = first; x < last; ++x, from += whole) {
            std::uint32_t block = 0;
            for (i64 k = 0; k < whole; ++k) block += from[k];
            blocks[x] = u8(std::lrint(float(block) * over));
        }
        return blocks;
    }
    static void spread(const u8 *row, const Axis *columns, i64 count, int *out) {
        for (i64 x = 0; x < count; ++x) {
            const Axis &at = columns[x];
            out[x] = row[at.first] * at.near + row[at.second] * at.far;
        }
    }
    static void blend(const int *upper, const int *lower, int near, int far, i64 count, u8 *out) {
        for (i64 x = 0; x < count; ++x) {
            out[x] = u8((((near * (upper[x] >> 4)) >> 16) + ((far * (lower[x] >> 4)) >> 16) + 2) >> 2);
        }
    }
};

constexpr double TOO_LARGE = -1, LEFT = -2;

// 0, or why there is no crop about points (x, y) that are a grid's pixels as far apart as said.
inline double crop(const Array<const u8> &luma, const double *points, i64 count, double face, const double *limits, GreyCrop &made) {
    const double face_pixels = limits[0], reach = limits[1], least = limits[2], most = limits[3];
    const double ratio = face_pixels / std::max(face, 1e-6), half = reach * face_pixels / ratio;
    const i64 width = luma.shape[1], height = luma.shape[0];
    if (!(half < most * double(std::max(width, height)))) return TOO_LARGE;
    double x = 0, y = 0;
    for (i64 k = 0; k < count; ++k) x += points[2 * k], y += points[2 * k + 1];
    x /= double(count), y /= double(count);
    if (!std::isfinite(x) || !std::isfinite(y)) return LEFT;
    const i64 x0 = within(std::floor(x - half), width), y0 = within(std::floor(y - half), height);
    const i64 x1 = within(std::ceil(x + half) + 1, width), y1 = within(std::ceil(y + half) + 1, height);
    const i64 whole = std::max<i64>(1, i64(1 / ratio));
    if (double(std::min(x1 - x0, y1 - y0)) < std::max(least, double(whole))) return LEFT;
    const i64 w = (x1 - x0) / whole * whole, h = (y1 - y0) / whole * whole;
    made.part = {luma.row(y0) + x0, w, h, luma.stride};
    made.whole = whole;
    made.width = std::max<i64>(8, std::lrint(double(w) * ratio)), made.height = std::max<i64>(8, std::lrint(double(h) * ratio));
    made.corner_x = double(x0), made.corner_y = double(y0);
    made.scale_x = double(made.width) / double(w), made.scale_y = double(made.height) / double(h);
    return 0;
}

double fit_cascade(Array<const u8> luma, Array<const double> start, Array<const double> points, Array<const double> rigid,
                   Array<const i64> vertices, Array<const float> weights, Array<const float> mean,
                   Array<const float> basis, Array<const float> deviations, Array<const float> stages,
                   Array<const float> texture_mean, Array<const float> texture_basis, Array<const double> limits,
                   Array<double> shape, Array<double> parameters) {
    const i64 count = points.shape[0], modes = deviations.shape[0];
    const Mesh mesh(vertices, weights, count);
    const i64 n = mesh.places, corrected = 4 + modes, steps = stages.shape[0], known = texture_basis.shape[0];
    require(luma.axes == 2, "luma must be (h, w)");
    require_points(points, std::max<i64>(count, 1), "points must be (v, 2)");
    require_points(start, count, "start must be (v, 2)");
    require_points(shape, count, "shape must be (v, 2)");
    require(rigid.size() == count && rigid.axes == 1 && rigid.stride == 1, "rigid must be (v,)");
    require(mean.size() == 2 * count && mean.axes == 1 && mean.stride == 1, "mean must be (2 v,)");
    require(basis.shape[0] == 2 * count && basis.shape[1] == modes && basis.axes == 2 && basis.stride == modes, "basis must be (2 v, k)");
    require(deviations.axes == 1 && deviations.stride == 1 && parameters.axes == 1 && parameters.stride == 1 && parameters.size() == modes, "parameters must be (k,)");
    require(stages.axes == 3 && (!steps || (stages.shape[1] == corrected && stages.shape[2] == 1 + n && stages.stride == corrected * (1 + n))), "stages must be (s, 4 + k, 1 + n)");
    require(texture_mean.axes == 1 && texture_mean.size() == n && texture_mean.stride == 1 && n > 0, "texture_mean must be (n,)");
    require(texture_basis.axes == 2 && texture_basis.shape[1] == n && texture_basis.stride == n, "texture_basis must be (m, n)");
    require(limits.axes == 1 && limits.size() == 5 && limits.stride == 1, "limits must be (5,)");

    double least = points.data[0], most = least;
    for (i64 k = 0; k < count; ++k) least = std::min(least, points.data[2 * k]), most = std::max(most, points.data[2 * k]);
    const double resolution = std::nearbyint(most - least), clip = limits.data[4];
    GreyCrop cut;
    const double size = Similarity::between(points.data, start.data, rigid.data, count).scale() * resolution;
    if (const double why = crop(luma, start.data, count, size, limits.data, cut)) return why;

    // Encode: what is left of the aligned shape is so much of each mode.
    double *now = memory<220, double>(2 * count), *way = memory<221, double>(corrected), *amounts = parameters.data;
    for (i64 k = 0; k < count; ++k) {
        now[2 * k] = (start.data[2 * k] - cut.corner_x + 0.5) * cut.scale_x - 0.5;
        now[2 * k + 1] = (start.data[2 * k + 1] - cut.corner_y + 0.5) * cut.scale_y - 0.5;
    }
    const Similarity to_grid = Similarity::between(now, points.data, rigid.data, count);
    for (i64 j = 0; j < modes; ++j) way[j] = 0;
    Point centre{};
    for (i64 k = 0; k < count; ++k) {
        const Point at = to_grid({now[2 * k], now[2 * k + 1]});
        const double x = at.x - double(mean.data[2 * k]), y = at.y - double(mean.data[2 * k + 1]);
        for (i64 j = 0; j < modes; ++j) way[j] += x * double(basis.data[2 * k * modes + j]) + y * double(basis.data[(2 * k + 1) * modes + j]);
        centre.x += rigid.data[k] * points.data[2 * k], centre.y += rigid.data[k] * points.data[2 * k + 1];
    }
    const auto clipped = [clip](double value) { return std::min(std::max(value, -clip), clip); };
    for (i64 j = 0; j < modes; ++j) amounts[j] = clipped(way[j] / double(deviations.data[j]));
    // From the grid to the crop.
    const double squared = to_grid.a * to_grid.a + to_grid.b * to_grid.b;
    Similarity pose{to_grid.a / squared, -to_grid.b / squared, 0, 0};
    pose.tx = -(pose.a * to_grid.tx - pose.b * to_grid.ty), pose.ty = -(pose.b * to_grid.tx + pose.a * to_grid.ty);

    float *places = memory<222, float>(2 * n), *features = memory<223, float>(n);
    const auto sample = [&] {
        mesh.lay(floats<224>(now, 2 * count), places);
        const Plane<u8> crop = cut.about(places, n);
        for (i64 k = 0; k < n; ++k) features[k] = float(nearest(crop.at(places[2 * k], places[2 * k + 1])));
        normalise(features, n);
    };
    const auto decode = [&] {
        for (i64 k = 0; k < count; ++k) {
            Point at{double(mean.data[2 * k]), double(mean.data[2 * k + 1])};
            for (i64 j = 0; j < modes; ++j) {
                const double amount = amounts[j] * double(deviations.data[j]);
                at.x += amount * double(basis.data[2 * k * modes + j]), at.y += amount * double(basis.data[(2 * k + 1) * modes + j]);
            }
            at = pose(at);
            now[2 * k] = at.x, now[2 * k + 1] = at.y;
        }
    };
    for (i64 step = 0; step < steps; ++step) {
        decode();
        sample();
        for (i64 j = 0; j < corrected; ++j) {
            const float *row = stages.row(step) + j * (1 + n);
            way[j] = double(row[0] + dot(features, row + 1, n));
        }
        // The correction turns and scales about the centre of the rigid points, on the grid.
        const double a = 1 + way[0], b = way[1];
        const Point shift{centre.x - (a * centre.x - b * centre.y) + way[2] * resolution,
                          centre.y - (b * centre.x + a * centre.y) + way[3] * resolution};
        const Point moved = pose(shift);
        pose = {a * pose.a - b * pose.b, a * pose.b + b * pose.a, moved.x, moved.y};
        for (i64 j = 0; j < modes; ++j) amounts[j] = clipped(amounts[j] + way[4 + j]);
    }
    if (steps) decode();
    sample();
    for (i64 k = 0; k < count; ++k) {
        shape.data[2 * k] = (now[2 * k] + 0.5) / cut.scale_x - 0.5 + cut.corner_x;
        shape.data[2 * k + 1] = (now[2 * k + 1] + 0.5) / cut.scale_y - 0.5 + cut.corner_y;
    }
    // What the person's texture leaves unexplained.
    for (i64 k = 0; k < n; ++k) features[k] -= texture_mean.data[k];
    double left = double(dot(features, features, n)), explained = 0;
    for (i64 j = 0; j < known; ++j) {
        const double share = double(dot(features, texture_basis.row(j), n));
        explained += share * share;
    }
    return std::sqrt(std::max(left - explained, 0.0) / double(n));
}
