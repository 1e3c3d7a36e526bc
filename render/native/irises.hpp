// Included by each instruction set in a namespace of its own: the iris of one person on the eyeball of another.

// In the order of the twin's `TintNumbers` and `TOLD`, where they are explained.
struct TintNumbers {
    double is_light, lightens, radius, dimmed, blur, moved, shown, kept, leap, first_known, all_known, first_eye, all_eye,
        white, reach, ring, max_difference, no_iris, all_iris, first_glare, all_glare, first_unlike, all_unlike, edge,
        catch_light, black, least_shade, most_shade;
};

inline float luma_of(const float *rgb) { return (0.299f * rgb[0] + 0.587f * rgb[1]) + 0.114f * rgb[2]; }

// Out: a colour (3,) by an affine map (3, 4).
inline void transform(const float *map, const float *colour, float *out) {
    for (int k = 0; k < 3; ++k) {
        const float *row = map + 4 * k;
        out[k] = ((row[0] * colour[0] + row[1] * colour[1]) + row[2] * colour[2]) + row[3];
    }
}

// Bilinear value of a plane, zero beyond it.
inline float value_at(Array<const float> plane, float x, float y) {
    const i64 h = plane.shape[0], w = plane.shape[1];
    if (!(x > -1 && y > -1 && x < float(w) && y < float(h))) return 0;
    const float fx = std::floor(x), fy = std::floor(y), u = x - fx, v = y - fy;
    const i64 left = i64(fx), top = i64(fy);
    if (left >= 0 && top >= 0 && left + 1 < w && top + 1 < h) {
        const float *one = plane.row(top) + left, *other = plane.row(top + 1) + left;
        const float upper = one[0] + u * (one[1] - one[0]), lower = other[0] + u * (other[1] - other[0]);
        return upper + v * (lower - upper);
    }
    const auto at = [&](i64 j, i64 k) { return j < 0 || k < 0 || j >= h || k >= w ? 0.0f : plane.row(j)[k]; };
    const float upper = at(top, left) + u * (at(top, left + 1) - at(top, left));
    const float lower = at(top + 1, left) + u * (at(top + 1, left + 1) - at(top + 1, left));
    return upper + v * (lower - upper);
}

// What rings about a middle hold, at a distance from it in radii.
struct Rings {
    const float *values;  // (count, channels)
    i64 count, channels;
    float per_radius;

    template <class F> void read(float away, const F &use) const {
        const float ring = std::min(std::max(per_radius * away - 0.5f, 0.0f), float(double(count) - 1.001));
        const i64 low = i64(ring);
        const float share = ring - float(low), *at = values + channels * low;
        for (i64 k = 0; k < channels; ++k) use(k, at[k] * (1 - share) + at[channels + k] * share);
    }
};

// The colour of the white among n pixels: the mean of the brightest.
inline void find_white(const float *rgb, const i64 *pixels, i64 n, double share, float *out) {
    using Bright = std::pair<float, i64>;
    Bright *all = memory<110, Bright>(n);
    for (i64 k = 0; k < n; ++k) all[k] = {-luma_of(rgb + 3 * pixels[k]), pixels[k]};
    const i64 count = std::max(i64(1), i64(std::nearbyint(double(n) * share)));
    std::nth_element(all, all + count - 1, all + n);
    double sum[3] = {};
    for (i64 k = 0; k < count; ++k) {
        for (int c = 0; c < 3; ++c) sum[c] += double(rgb[3 * all[k].second + c]);
    }
    for (int c = 0; c < 3; ++c) out[c] = std::max(float(sum[c] / double(count)), 8.0f);
}

// Where the iris is most likely, by colours (n, 3) at places, shares of the white.
struct IrisSearch {
    const TintNumbers &told;
    const float *colours, *x, *y;
    i64 n;
    const float *direction;
    Rings source;
    float *away, *unlike;

    // Differences from white on the disc less those on the ring about it, or minus those from the iris at rest.
    double score(float at_x, float at_y) const {
        const float radius = float(told.radius), ring = float(told.ring);
        for (i64 k = 0; k < n; ++k) {
            const float dx = x[k] - at_x, dy = y[k] - at_y;
            away[k] = std::sqrt(dx * dx + dy * dy) / radius;
        }
        double within = 0, beside = 0;
        i64 inner = 0, outer = 0;
        if (told.is_light) {
            for (i64 k = 0; k < n; ++k) {
                if (!(away[k] < ring)) continue;
                float off = 0;
                source.read(away[k], [&](i64 c, float usual) { off += std::fabs(colours[3 * k + c] - usual); });
                beside += double(std::min(off, float(told.max_difference)));
                ++outer;
            }
        } else {
            for (i64 k = 0; k < n; ++k) {
                const bool on = away[k] < 1, about = !on && away[k] < ring;
                within += on ? double(unlike[k]) : 0;
                beside += about ? double(unlike[k]) : 0;
                inner += on;
                outer += about;
            }
        }
        return within / double(std::max(inner, i64(1))) - beside / double(std::max(outer, i64(1)));
    }

    // Begin at a place (2,), and put there what is found.
    void run(Array<const double> moves, double *place) const {
        for (i64 k = 0; k < n && !told.is_light; ++k) {
            const float *colour = colours + 3 * k;
            unlike[k] = (direction[0] * (1 - colour[0]) + direction[1] * (1 - colour[1])) + direction[2] * (1 - colour[2]);
        }
        const double start_x = place[0], start_y = place[1];
        for (i64 k = 0; k < moves.shape[0];) {
            const double round = moves.data[3 * k], from_x = place[0], from_y = place[1];
            double most = -INFINITY;
            for (; k < moves.shape[0] && moves.data[3 * k] == round; ++k) {
                const double to_x = from_x + moves.data[3 * k + 1], to_y = from_y + moves.data[3 * k + 2];
                const double away_x = double(float(to_x)) - start_x, away_y = double(float(to_y)) - start_y;
                const double found = score(float(to_x), float(to_y)) - told.moved * std::hypot(away_x, away_y);
                if (found > most) most = found, place[0] = to_x, place[1] = to_y;
            }
        }
    }
};

void tint_iris(Array<const float> places, Array<const float> axes, Array<const float> cells, Array<const double> to_cells,
               Array<const float> lids, Array<const i64> looked_at, Array<const float> to_rgb,
               Array<const float> from_rgb, Array<const double> moves, Array<const float> factors,
               Array<const float> profiles, Array<const double> numbers, Array<double> gaze, Array<float> eye) {
    const i64 h = eye.shape[0], w = eye.shape[1], n = h * w, looks = looked_at.shape[0], rings = profiles.shape[1];
    const auto dense = [](const auto &array, i64 a, i64 b) {
        return array.axes == 2 && array.shape[0] == a && array.shape[1] == b && (array.stride == b || a <= 1);
    };
    require(eye.axes == 3 && eye.shape[2] == 3 && eye.stride == 3 * w, "eye must be (h, w, 3)");
    require(lids.axes == 2 && lids.shape[0] == h && lids.shape[1] == w, "lids must be (h, w)");
    require(dense(places, n, 2) && dense(axes, 3, 2) && dense(gaze, 2, 2), "places, axes and gaze must be (n, 2)");
    require(cells.axes == 2 && dense(to_cells, 2, 3), "cells must be (m, m), and to_cells (2, 3)");
    require(dense(to_rgb, 3, 4) && dense(from_rgb, 3, 4) && dense(factors, 2, 3), "colours must be (3, 4), factors (2, 3)");
    require(profiles.axes == 3 && profiles.shape[0] == 2 && profiles.shape[2] == 3 && rings > 1 && profiles.stride == 3 * rings,
            "profiles must be (2, rings, 3)");
    require(dense(moves, moves.shape[0], 3) && looked_at.axes == 1 && looked_at.stride == 1, "moves must be (k, 3)");
    TintNumbers told;
    require(numbers.axes == 1 && numbers.stride == 1 && numbers.shape[0] * i64(sizeof(double)) == i64(sizeof told),
            "numbers must be those of TintNumbers and TOLD");
    std::memcpy(&told, numbers.data, sizeof told);

    // How far the parsing sees an eye there, and which pixels lie between the lids.
    float *seen = memory<111, float>(n), map[6], most = 0;
    for (int k = 0; k < 6; ++k) map[k] = float(to_cells.data[k]);
    for (i64 k = 0; k < n; ++k) {
        const float x = places.data[2 * k], y = places.data[2 * k + 1];
        seen[k] = value_at(cells, (map[0] * x + map[1] * y) + map[2], (map[3] * x + map[4] * y) + map[5]);
        most = std::max(most, seen[k]);
    }
    const float known = ramp(most, told.first_known, told.all_known), whole = std::max(most, 1e-6f);
    float best = 0;
    for (i64 k = 0; k < n; ++k) {
        seen[k] = float(told.shown) * (1 - known * (1 - ramp(seen[k] / whole, told.first_eye, told.all_eye)));
        best = std::max(best, seen[k]);
    }
    i64 *inside = memory<112, i64>(2 * n), *matt = inside + n, count = 0, matts = 0;
    float *rgb = memory<113, float>(3 * n);
    for (i64 k = 0; k < n; ++k) transform(to_rgb.data, eye.data + 3 * k, rgb + 3 * k);
    for (i64 y = 0; y < h; ++y) {
        const float *line = lids.row(y);
        for (i64 x = 0; x < w; ++x) {
            const i64 k = y * w + x;
            if (!(line[x] > 0.5f)) continue;
            inside[count++] = k;
            if (luma_of(rgb + 3 * k) < float(told.first_glare)) matt[matts++] = k;
        }
    }
    if (best == 0 || count == 0) return;
    float bright[3];
    find_white(rgb, matts ? matt : inside, matts ? matts : count, told.white, bright);

    // Places in the eye, and where its iris is.
    float *x = memory<114, float>(2 * n), *y = x + n, *away = memory<115, float>(n);
    const float *axis = axes.data;
    for (i64 k = 0; k < n; ++k) {
        const float dx = places.data[2 * k] - axis[0], dy = places.data[2 * k + 1] - axis[1];
        x[k] = dx * axis[2] + dy * axis[4];
        y[k] = dx * axis[3] + dy * axis[5];
    }
    float *look = memory<116, float>(7 * looks), *look_x = look + 3 * looks, *look_y = look_x + looks;
    for (i64 k = 0; k < looks; ++k) {
        const i64 at = looked_at.data[k];
        require(at >= 0 && at < n, "looked_at must name pixels");
        look_x[k] = x[at], look_y[k] = y[at];
        for (int c = 0; c < 3; ++c) look[3 * k + c] = rgb[3 * at + c] / bright[c];
    }
    const float per_radius = float(double(rings) / told.reach);
    const Rings source{profiles.data, rings, 3, per_radius}, target{profiles.row(1), rings, 3, per_radius};
    double found[2] = {gaze.data[0], gaze.data[1]};
    IrisSearch{told, look, look_x, look_y, looks, factors.row(1), source, look_y + looks, look_y + 2 * looks}.run(moves, found);
    double *kept = gaze.row(1);
    const double step[] = {kept[0] - found[0], kept[1] - found[1]};
    const double share = std::hypot(step[0], step[1]) < told.leap ? told.kept : 0;
    for (int k = 0; k < 2; ++k) kept[k] = found[k] + share * step[k];
    const float middle_x = float(kept[0]), middle_y = float(kept[1]), radius = float(told.radius);
    for (i64 k = 0; k < n; ++k) {
        const float dx = x[k] - middle_x, dy = y[k] - middle_y;
        away[k] = std::sqrt(dx * dx + dy * dy) / radius;
    }

    // What catches light on a painted iris, how bright the eye is without it, and how bright it would be at rest.
    const bool painted = told.lightens || told.is_light;
    float *gleams = nullptr, *luma = nullptr, *at_rest = nullptr;
    if (painted) {
        gleams = memory<117, float>(5 * n), luma = gleams + 3 * n, at_rest = luma + n;
        float *greys = memory<118, float>(rings);
        for (i64 k = 0; k < rings; ++k) {
            const float *ring = profiles.data + 3 * k;
            const float lit[] = {ring[0] * bright[0], ring[1] * bright[1], ring[2] * bright[2]};
            greys[k] = luma_of(lit);
        }
        const float whitest = float(told.catch_light) * luma_of(bright);
        for (i64 k = 0; k < n; ++k) {
            float pixel[] = {rgb[3 * k], rgb[3 * k + 1], rgb[3 * k + 2]};
            Rings{greys, rings, 1, per_radius}.read(away[k], [&](i64, float grey) { at_rest[k] = grey; });
            if (away[k] < float(told.no_iris)) {
                float brighter[3];
                source.read(away[k], [&](i64 c, float own) { brighter[c] = pixel[c] - own * bright[c]; });
                const float gleam = std::min(std::max((luma_of(brighter) / whitest - 1) * 2, 0.0f), 1.0f);
                const float inner = gleam * ramp(away[k], 1, told.edge);
                for (int c = 0; c < 3; ++c) pixel[c] -= gleams[3 * k + c] = std::max(brighter[c], 0.0f) * inner;
            }
            luma[k] = luma_of(pixel);
        }
        gaussian(luma, h, w, told.blur, luma);
        gaussian(at_rest, h, w, told.blur, at_rest);
    }

    // The change of each pixel about the iris.
    const float *gain = factors.data, *direction = factors.row(1);
    for (i64 k = 0; k < n; ++k) {
        if (!(away[k] < float(told.no_iris))) continue;
        const float *before = rgb + 3 * k;
        float after[3], own[3], unlike = 0;
        for (int c = 0; c < 3; ++c) unlike += direction[c] * (1 - before[c] / bright[c]);
        if (painted) {
            const float lit = luma[k] / std::max(at_rest[k], 4.0f);
            const float shade = std::min(std::max(lit, float(told.least_shade)), float(told.most_shade));
            source.read(away[k], [&](i64 c, float value) { own[c] = value; });
            target.read(away[k], [&](i64 c, float value) {
                const float other = float(told.dimmed) * value, gleam = gleams[3 * k + c];
                const float structure = (before[c] - gleam) - own[c] * bright[c] * shade;
                const float weaker = std::min(other / std::max(own[c], float(told.black)), 1.0f);
                after[c] = other * bright[c] * shade + gleam + structure * weaker;
            });
        } else {
            for (int c = 0; c < 3; ++c) after[c] = gain[c] * before[c];
        }
        float shown = ramp(away[k], told.no_iris, told.all_iris) * (1 - ramp(luma_of(before), told.first_glare, told.all_glare));
        if (!told.is_light) shown *= ramp(unlike, told.first_unlike, told.all_unlike);
        shown *= lids.row(k / w)[k % w] * seen[k];
        for (int c = 0; c < 3; ++c) after[c] = before[c] + shown * (after[c] - before[c]);
        transform(from_rgb.data, after, eye.data + 3 * k);
    }
}
