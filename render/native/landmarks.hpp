// Included by each instruction set in a namespace of its own: the points that a landmarker finds.

inline Point between(const double *points, i64 from, i64 to) {
    return {points[2 * to] - points[2 * from], points[2 * to + 1] - points[2 * from + 1]};
}

inline void require_names(const Array<const i64> &some, i64 size, i64 count, const char *why) {
    require(some.axes == 1 && some.size() == size && some.stride == 1, why);
    for (i64 k = 0; k < size; ++k) require(some.data[k] >= 0 && some.data[k] < count, why);
}

void upright_box(Array<const double> points, Array<const i64> eyes, Array<double> made) {
    const i64 count = points.shape[0];
    require_points(points, count, "points must be (n, 2)");
    require_names(eyes, 2, count, "eyes must name two points");
    require(made.axes == 1 && made.size() == 4 && made.stride == 1, "made must be (4,)");
    const Point way = between(points.data, eyes.data[0], eyes.data[1]);
    const double turn = std::atan2(way.y, way.x), cos = std::cos(turn), sin = std::sin(turn);
    double low_x = INFINITY, low_y = INFINITY, high_x = -INFINITY, high_y = -INFINITY;
    for (i64 k = 0; k < count; ++k) {
        const double x = points.data[2 * k], y = points.data[2 * k + 1];
        const double along = x * cos + y * sin, down = y * cos - x * sin;
        low_x = std::min(low_x, along), high_x = std::max(high_x, along);
        low_y = std::min(low_y, down), high_y = std::max(high_y, down);
    }
    const double x = (low_x + high_x) / 2, y = (low_y + high_y) / 2;
    made.data[0] = cos * x - sin * y, made.data[1] = sin * x + cos * y;
    made.data[2] = std::max(high_x - low_x, high_y - low_y), made.data[3] = turn;
}

double judge_points(Array<const double> points, Array<const double> sigma, double bias, double width, double height,
                    Array<const i64> eyes, Array<const double> rules, Array<float> certain) {
    const i64 count = points.shape[0];
    require_points(points, count, "points must be (n, 2)");
    require(sigma.axes == 1 && sigma.size() == count && sigma.stride == 1, "sigma must be (n,)");
    require(certain.axes == 1 && certain.size() == count && certain.stride == 1, "certain must be (n,)");
    require_names(eyes, 2, count, "eyes must name two points");
    require(rules.axes == 1 && rules.size() == 7 && rules.stride == 1, "rules must be (7,)");
    const double *rule = rules.data;
    const Point way = between(points.data, eyes.data[0], eyes.data[1]);
    const double apart = std::sqrt(way.x * way.x + way.y * way.y);
    double low_x = INFINITY, low_y = INFINITY, high_x = -INFINITY, high_y = -INFINITY, spread = 0;
    i64 visible = 0;
    for (i64 k = 0; k < count; ++k) {
        const double x = points.data[2 * k], y = points.data[2 * k + 1];
        if (!std::isfinite(x) || !std::isfinite(y)) return 0;
        low_x = std::min(low_x, x), high_x = std::max(high_x, x);
        low_y = std::min(low_y, y), high_y = std::max(high_y, y);
        visible += x >= -0.5 && y >= -0.5 && x <= width - 0.5 && y <= height - 0.5;
        spread += sigma.data[k];
    }
    if (!(std::min(high_x - low_x, high_y - low_y) > rule[5] && apart > rule[6])) return 0;
    if (double(visible) / double(count) < rule[2]) return 0;
    const double z = bias + rule[0] * std::log(std::max(spread / double(count) / apart, 1e-6));
    const double confidence = 1 / (1 + std::exp(-std::min(std::max(z, -60.0), 60.0)));
    if (!(confidence >= rule[3])) return 0;
    for (i64 k = 0; k < count; ++k) {
        const double reach = rule[4] * apart / std::max(rule[1] * sigma.data[k], 1e-6);
        certain.data[k] = float(1 - std::exp(-0.5 * (reach * reach)));
    }
    return confidence;
}

void correct_points(Array<const double> points, Array<const i64> parts, Array<const float> centre, Array<const float> axes,
                    Array<const float> scale, Array<const float> weights, double most, double full, Array<double> corrected) {
    const i64 count = points.shape[0], modes = axes.shape[1], entries = 1 + 3 * modes + 3;
    require_points(points, count, "points must be (n, 2)");
    require_points(corrected, count, "corrected must be (n, 2)");
    require_names(parts, 15, count, "parts must name 15 points");
    require(centre.axes == 1 && centre.size() == 2 * count && centre.stride == 1, "centre must be (2 n,)");
    require(axes.axes == 2 && axes.shape[0] == 2 * count && axes.stride == modes, "axes must be (2 n, k)");
    require(scale.axes == 1 && scale.size() == 3 && scale.stride == 1, "scale must be (3,)");
    require(weights.axes == 2 && weights.shape[0] == entries && weights.shape[1] == 2 * count && weights.stride == 2 * count,
            "weights must be (1 + 3 k + 3, 2 n)");
    const i64 *part = parts.data;
    Point middle{}, eyes{};
    for (i64 k = 0; k < count; ++k) middle.x += points.data[2 * k], middle.y += points.data[2 * k + 1];
    middle.x /= double(count), middle.y /= double(count);
    for (int k = 0; k < 6; ++k) {
        const Point way = between(points.data, part[k], part[6 + k]);
        eyes.x += way.x / 6, eyes.y += way.y / 6;
    }
    const double length = std::sqrt(eyes.x * eyes.x + eyes.y * eyes.y), cos = eyes.x / length, sin = eyes.y / length;
    double size = 0;
    for (i64 k = 0; k < count; ++k) {
        const double x = points.data[2 * k] - middle.x, y = points.data[2 * k + 1] - middle.y;
        size += x * x + y * y;
    }
    size = std::sqrt(size / double(count));
    float *upright = memory<230, float>(2 * count), *found = memory<231, float>(modes), *change = memory<232, float>(2 * count);
    for (i64 k = 0; k < count; ++k) {
        const double x = points.data[2 * k] - middle.x, y = points.data[2 * k + 1] - middle.y;
        upright[2 * k] = float((x * cos + y * sin) / size), upright[2 * k + 1] = float((y * cos - x * sin) / size);
    }
    const float turn = std::atan(upright[2 * part[12]] - (upright[2 * part[13]] + upright[2 * part[14]]) / 2);
    std::fill(found, found + modes, 0.0f);
    for (i64 i = 0; i < 2 * count; ++i) {
        const float away = upright[i] - centre.data[i], *row = axes.row(i);
        for (i64 j = 0; j < modes; ++j) found[j] += away * row[j];
    }
    double powers[4] = {1, 0, 0, 0}, power = 1;
    for (int k = 1; k < 4; ++k) power *= double(turn), powers[k] = power / double(scale.data[k - 1]);
    std::copy(weights.data, weights.data + 2 * count, change);
    const auto add = [&](i64 entry, double seen) {
        const float share = float(seen), *row = weights.row(entry);
        for (i64 i = 0; i < 2 * count; ++i) change[i] += share * row[i];
    };
    for (i64 j = 0; j < modes; ++j) {
        const double amount = double(std::min(std::max(found[j], -float(most)), float(most)));
        for (int k = 0; k < 3; ++k) add(1 + 3 * j + k, amount * powers[k]);
    }
    for (int k = 1; k < 4; ++k) add(entries - 4 + k, powers[k]);
    const double share = std::min(std::abs(double(turn)) / full, 1.0) * size;
    for (i64 k = 0; k < count; ++k) {
        const double x = double(change[2 * k]), y = double(change[2 * k + 1]);
        corrected.data[2 * k] = points.data[2 * k] + share * (x * cos - y * sin);
        corrected.data[2 * k + 1] = points.data[2 * k + 1] + share * (x * sin + y * cos);
    }
}

i64 plausible_motion(Array<const double> previous, Array<const double> current, Array<const i64> eyes, Array<const double> limits) {
    const i64 count = previous.shape[0];
    require_points(previous, count, "previous must be (n, 2)");
    require_points(current, count, "current must be (n, 2)");
    require_names(eyes, 2, count, "eyes must name two points");
    require(limits.axes == 1 && limits.size() == 4 && limits.stride == 1, "limits must be (4,)");
    const double least = limits.data[0], growth = limits.data[1], motion = limits.data[2], bend = limits.data[3];
    const i64 right = eyes.data[0], left = eyes.data[1];
    const Point old = between(previous.data, right, left), now = between(current.data, right, left);
    const double before = std::sqrt(old.x * old.x + old.y * old.y), after = std::sqrt(now.x * now.x + now.y * now.y);
    if (!(before > 0 && after >= least && 1 / growth < after / before && after / before < growth)) return 0;
    double *weights = memory<233, double>(count), x = 0, y = 0, off = 0;
    for (i64 k = 0; k < count; ++k) {
        weights[k] = 1 / double(count);
        x += weights[k] * (current.data[2 * k] - previous.data[2 * k]), y += weights[k] * (current.data[2 * k + 1] - previous.data[2 * k + 1]);
    }
    if (!(std::sqrt(x * x + y * y) / before < motion)) return 0;
    const Similarity back = Similarity::between(current.data, previous.data, weights, count);
    for (i64 k = 0; k < count; ++k) {
        const Point at = back({current.data[2 * k], current.data[2 * k + 1]});
        const double dx = at.x - previous.data[2 * k], dy = at.y - previous.data[2 * k + 1];
        off += weights[k] * (dx * dx + dy * dy);
    }
    return std::sqrt(off) / before < bend;
}

void place_points(Array<const float> found, Array<const float> deviations, Array<const double> to_picture,
                  Array<double> points, Array<double> sigma) {
    const i64 count = points.shape[0];
    require_points(found, count, "found must be (n, 2)");
    require_points(points, count, "points must be (n, 2)");
    require(deviations.axes == 1 && deviations.size() == count && deviations.stride == 1, "deviations must be (n,)");
    require(sigma.axes == 1 && sigma.size() == count && sigma.stride == 1, "sigma must be (n,)");
    require(to_picture.axes == 2 && to_picture.shape[0] == 2 && to_picture.shape[1] == 3 && to_picture.stride == 3, "to_picture must be (2, 3)");
    const double *map = to_picture.data, scale = std::hypot(map[0], map[3]);
    for (i64 k = 0; k < count; ++k) {
        const double x = double(found.data[2 * k]), y = double(found.data[2 * k + 1]);
        points.data[2 * k] = x * map[0] + y * map[1] + map[2], points.data[2 * k + 1] = x * map[3] + y * map[4] + map[5];
        sigma.data[k] = double(deviations.data[k]) * scale;
    }
}

void filter_shape(Array<const double> shape, Array<const double> gain, Array<const i64> eyes, Array<double> steps, Array<double> filtered) {
    const i64 count = shape.shape[0];
    require_points(shape, count, "shape must be (n, 2)");
    require_points(steps, count, "steps must be (n, 2)");
    require_points(filtered, count, "filtered must be (n, 2)");
    require(gain.axes == 2 && gain.shape[0] == count && gain.shape[1] == count && gain.stride == count, "gain must be (n, n)");
    require_names(eyes, 2, count, "eyes must name two points");
    double *squared = memory<234, double>(count), *step = steps.data, *last = filtered.data;
    for (i64 k = 0; k < 2 * count; ++k) step[k] = (step[k] + (shape.data[k] - last[k])) / 2;
    for (i64 k = 0; k < count; ++k) squared[k] = step[2 * k] * step[2 * k] + step[2 * k + 1] * step[2 * k + 1];
    const Point way = between(shape.data, eyes.data[0], eyes.data[1]);
    const double apart = std::max(way.x * way.x + way.y * way.y, 1e-6);
    for (i64 k = 0; k < count; ++k) {
        const double moved = dot(gain.row(k), squared, count) / apart, share = moved / (1 + moved);
        for (i64 at = 2 * k; at < 2 * k + 2; ++at) last[at] += share * (shape.data[at] - last[at]), step[at] *= 1 - share;
    }
}
