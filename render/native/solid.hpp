// Included by each instruction set in a namespace of its own: the solid shape of a face.

// The solution of a symmetric positive system (n, n), whose lower half is given and lost, in place of its right side.
inline bool solve(double *matrix, double *right, i64 n) {
    for (i64 i = 0; i < n; ++i) {
        double *row = matrix + i * n;
        for (i64 j = 0; j <= i; ++j) {
            const double left = row[j] - dot(row, matrix + j * n, j);
            if (j < i) {
                row[j] = left * matrix[j * n + j];
            } else if (left < std::numeric_limits<double>::epsilon()) {
                return false;
            } else {
                row[i] = 1 / std::sqrt(left);
            }
        }
    }
    for (i64 i = 0; i < n; ++i) right[i] = (right[i] - dot(matrix + i * n, right, i)) * matrix[i * n + i];
    for (i64 i = n - 1; i >= 0; --i) {
        right[i] *= matrix[i * n + i];
        for (i64 j = 0; j < i; ++j) right[j] -= matrix[i * n + j] * right[i];
    }
    return true;
}

// The rotation about a vector by its length (Rodrigues), times another one, in place of that.
inline void turn(const double *vector, double *rotation) {
    const double angle = std::sqrt(vector[0] * vector[0] + vector[1] * vector[1] + vector[2] * vector[2]);
    const double over = std::max(angle, 1e-12), x = vector[0] / over, y = vector[1] / over, z = vector[2] / over;
    const double sine = std::sin(angle), rest = 1 - std::cos(angle);
    const double k[3][3] = {{0, -z, y}, {z, 0, -x}, {-y, x, 0}};
    double made[9];
    for (int i = 0; i < 3; ++i) {
        double row[3];
        for (int j = 0; j < 3; ++j) {
            const double squared = k[i][0] * k[0][j] + k[i][1] * k[1][j] + k[i][2] * k[2][j];
            row[j] = double(i == j) + sine * k[i][j] + rest * squared;
        }
        for (int j = 0; j < 3; ++j) made[3 * i + j] = row[0] * rotation[j] + row[1] * rotation[3 + j] + row[2] * rotation[6 + j];
    }
    std::copy(made, made + 9, rotation);
}

void solid_fit(Array<const double> points, Array<const double> mean, Array<const double> modes, Array<const double> noise,
               Array<const double> middle, Array<const double> precision, i64 steps, double outlier,
               Array<double> rotation, Array<double> place, Array<double> amounts, Array<double> solid) {
    const i64 count = points.shape[0], known = modes.shape[0], size = 6 + known, width = 2 * count;
    require_points(points, count, "points must be (v, 2)");
    const auto is_solid = [count](const auto &array) { return array.axes == 2 && array.shape[0] == count && array.shape[1] == 3 && array.stride == 3; };
    const auto has = [](const auto &array, i64 n) { return array.axes == 1 && array.shape[0] == n && (n < 2 || array.stride == 1); };
    require(is_solid(mean) && is_solid(solid), "mean and solid must be (v, 3)");
    require(modes.axes == 3 && (!known || (modes.shape[1] == count && modes.shape[2] == 3 && modes.stride == 3 * count)), "modes must be (k, v, 3)");
    require(has(noise, count), "noise must be (v,)");
    require(has(middle, known) && has(precision, known) && has(amounts, known), "middle, precision and amounts must be (k,)");
    require(rotation.axes == 2 && rotation.shape[0] == 3 && rotation.shape[1] == 3 && rotation.stride == 3, "rotation must be (3, 3)");
    require(has(place, 3), "place must be (3,)");
    double *design = memory<240, double>(size * width), *normal = memory<241, double>(size * size);
    double *right = memory<242, double>(size), *away = memory<243, double>(width), *r = rotation.data;
    const auto shape = [&] {
        std::copy(mean.data, mean.data + 3 * count, solid.data);
        for (i64 j = 0; j < known; ++j) {
            const double amount = amounts.data[j], *mode = modes.row(j);
            for (i64 k = 0; k < 3 * count; ++k) solid.data[k] += amount * mode[k];
        }
    };
    for (i64 step = 0; step < steps; ++step) {
        shape();
        const double scale = place.data[0];
        double turned[6];
        for (int k = 0; k < 6; ++k) turned[k] = scale * r[k];
        // A column for each point's x, then for each point's y; rows: turns about x, y, z, scale, translation, modes.
        double *row = design;
        std::fill(design, design + 6 * width, 0.0);
        for (i64 k = 0; k < count; ++k) {
            const double *at = solid.data + 3 * k;
            const double x = r[0] * at[0] + r[1] * at[1] + r[2] * at[2], y = r[3] * at[0] + r[4] * at[1] + r[5] * at[2];
            const double z = r[6] * at[0] + r[7] * at[1] + r[8] * at[2], sigma = scale * noise.data[k];
            const double dx = points.data[2 * k] - scale * x - place.data[1], dy = points.data[2 * k + 1] - scale * y - place.data[2];
            const double far = (dx * dx + dy * dy) / (outlier * sigma * (outlier * sigma));
            const double weight = 1 / (sigma * std::sqrt(1 + far));
            away[k] = dx * weight, away[count + k] = dy * weight;
            row[count + k] = -z * scale * weight;
            row[width + k] = z * scale * weight;
            row[2 * width + k] = -y * scale * weight, row[2 * width + count + k] = x * scale * weight;
            row[3 * width + k] = x * weight, row[3 * width + count + k] = y * weight;
            row[4 * width + k] = weight, row[5 * width + count + k] = weight;
        }
        const double *weights = design + 4 * width;
        for (i64 j = 0; j < known; ++j) {
            const double *mode = modes.row(j);
            double *out = design + (6 + j) * width;
            for (i64 k = 0; k < count; ++k) {
                const double *at = mode + 3 * k;
                out[k] = (turned[0] * at[0] + turned[1] * at[1] + turned[2] * at[2]) * weights[k];
                out[count + k] = (turned[3] * at[0] + turned[4] * at[1] + turned[5] * at[2]) * weights[k];
            }
        }
        for (i64 i = 0; i < size; ++i) {
            for (i64 j = 0; j <= i; ++j) normal[i * size + j] = dot(design + i * width, design + j * width, width);
            right[i] = dot(design + i * width, away, width);
            normal[i * size + i] += 1e-9;
            if (i < 6) continue;
            const double sure = precision.data[i - 6];
            normal[i * size + i] += sure;
            right[i] -= sure * (amounts.data[i - 6] - middle.data[i - 6]);
        }
        if (!solve(normal, right, size)) return shape();
        turn(right, r);
        place.data[0] = std::min(std::max(scale + right[3], 0.5 * scale), 2 * scale);
        place.data[1] += right[4], place.data[2] += right[5];
        for (i64 j = 0; j < known; ++j) amounts.data[j] += right[6 + j];
    }
    shape();
}

// A row of values through a layer (from, to) with a bias.
inline void layer(const float *values, i64 from, const Array<const float> &weights, const Array<const float> &bias, float *out) {
    const i64 to = bias.shape[0];
    std::copy(bias.data, bias.data + to, out);
    for (i64 k = 0; k < from; ++k) {
        const float value = values[k], *row = weights.row(k);
        for (i64 j = 0; j < to; ++j) out[j] += value * row[j];
    }
}
inline void activate(float *values, i64 count) {
    for (i64 k = 0; k < count; ++k) values[k] /= 1 + std::exp(-values[k]);
}

void transfer_shape(Array<const double> shape, Array<const double> points, Array<const double> rigid, Array<const double> linear,
                    Array<const double> source, Array<const double> target, Array<const float> centre, Array<const float> scale,
                    Array<const float> weight_0, Array<const float> bias_0, Array<const float> weight_1, Array<const float> bias_1,
                    Array<const float> weight_2, Array<const float> bias_2, Array<const i64> features, i64 held,
                    Array<const i64> lids, Array<const i64> lips, Array<const i64> drawn, Array<const double> limits,
                    Array<double> made) {
    const i64 count = points.shape[0], known = features.shape[0], inputs = 4 * count;
    require_points(points, count, "points must be (v, 2)");
    require_points(shape, count, "shape must be (v, 2)");
    require_points(made, count, "made must be (v, 2)");
    const auto has = [](const auto &array, i64 n) { return array.axes == 1 && array.shape[0] == n && (n < 2 || array.stride == 1); };
    const auto is = [](const auto &array, i64 h, i64 w) { return array.axes == 2 && array.shape[0] == h && array.shape[1] == w && array.stride == w; };
    require(has(rigid, count) && has(limits, 5), "rigid must be (v,) and limits (5,)");
    require(is(linear, 3, 2) && is(source, count, 3) && is(target, count, 3), "linear must be (3, 2), source and target (v, 3)");
    const i64 first = bias_0.shape[0], second = bias_1.shape[0];
    require(has(centre, inputs) && has(scale, inputs) && has(bias_0, first) && has(bias_1, second) && has(bias_2, bias_2.shape[0]), "numbers of the network must fit");
    require(is(weight_0, inputs, first) && is(weight_1, first, second) && is(weight_2, second, bias_2.shape[0]), "layers of the network must fit");
    require((known == 0 || 2 * known == bias_2.shape[0]) && held >= 0, "features must be those of the network");
    require(lids.shape[0] == 2 && lips.shape[0] == 2, "lids and lips must be (2, n)");
    const auto names = [count](const Array<const i64> &array) {
        for (i64 k = 0; k < array.size(); ++k) require(array.data[k] >= 0 && array.data[k] < count, "points must be named");
    };
    names(features), names(lids), names(lips), names(drawn);
    const double most = limits.data[0], most_open = limits.data[1], inside = limits.data[2], gap = limits.data[3], resolution = limits.data[4];

    // The tracked shape on the grid; both at rest as they are turned, anywhere.
    double *seen = memory<244, double>(6 * count), *own = seen + 2 * count, *other = own + 2 * count, *out = made.data;
    const Similarity to_grid = Similarity::between(shape.data, points.data, rigid.data, count);
    double view[3][2];
    for (int k = 0; k < 3; ++k) {
        const double x = linear.data[2 * k], y = linear.data[2 * k + 1];
        view[k][0] = to_grid.a * x - to_grid.b * y, view[k][1] = to_grid.b * x + to_grid.a * y;
    }
    Point middle{};
    for (i64 k = 0; k < count; ++k) {
        const Point at = to_grid({shape.data[2 * k], shape.data[2 * k + 1]});
        seen[2 * k] = at.x, seen[2 * k + 1] = at.y;
        for (int axis = 0; axis < 2; ++axis) {
            const double *s = source.data + 3 * k, *t = target.data + 3 * k;
            own[2 * k + axis] = s[0] * view[0][axis] + s[1] * view[1][axis] + s[2] * view[2][axis];
            other[2 * k + axis] = t[0] * view[0][axis] + t[1] * view[1][axis] + t[2] * view[2][axis];
            out[2 * k + axis] = seen[2 * k + axis] + other[2 * k + axis] - own[2 * k + axis];
        }
        middle.x += (at.x - own[2 * k]) / double(count), middle.y += (at.y - own[2 * k + 1]) / double(count);
    }
    if (known) {  // as the network corrects it; those held as at rest
        float *values = memory<245, float>(inputs), *one = memory<246, float>(first), *two = memory<247, float>(second);
        float *moved = memory<248, float>(4 * known), *still = moved + 2 * known;
        for (int rest = 0; rest < 2; ++rest) {
            for (i64 k = 0; k < inputs; ++k) {
                const i64 at = k % (2 * count);
                double value = k < 2 * count ? (rest ? 0 : seen[at] - own[at] - (at % 2 ? middle.y : middle.x)) : other[at] - own[at];
                value = (value / resolution - double(centre.data[k])) / double(scale.data[k]);
                values[k] = float(std::min(std::max(value, -most), most));
            }
            layer(values, inputs, weight_0, bias_0, one);
            activate(one, first);
            layer(one, first, weight_1, bias_1, two);
            activate(two, second);
            layer(two, second, weight_2, bias_2, rest ? still : moved);
        }
        for (i64 k = 0; k < known; ++k) {
            const float *by = (k < held ? still : moved) + 2 * k;
            double *at = out + 2 * features.data[k];
            at[0] += resolution * double(by[0]), at[1] += resolution * double(by[1]);
        }
    }
    // Lids open by ratio; lips by as much as the source's, and the difference of both at rest as they do.
    const auto apart = [out](i64 upper, i64 lower, Point way) {
        const Point middle{(out[2 * upper] + out[2 * lower]) / 2, (out[2 * upper + 1] + out[2 * lower + 1]) / 2};
        out[2 * upper] = middle.x - way.x / 2, out[2 * upper + 1] = middle.y - way.y / 2;
        out[2 * lower] = middle.x + way.x / 2, out[2 * lower + 1] = middle.y + way.y / 2;
    };
    const auto way = [](const double *from, i64 upper, i64 lower) {
        return Point{from[2 * lower] - from[2 * upper], from[2 * lower + 1] - from[2 * upper + 1]};
    };
    for (i64 k = 0; k < lids.shape[1]; ++k) {
        const i64 upper = lids.row(0)[k], lower = lids.row(1)[k];
        const double ratio = way(seen, upper, lower).y / std::max(way(own, upper, lower).y, gap);
        const double open = std::min(std::max(ratio, 0.0), most_open);
        const Point rest = way(other, upper, lower);
        apart(upper, lower, {open * rest.x, open * rest.y});
    }
    for (i64 k = 0; k < lips.shape[1]; ++k) {
        const i64 upper = lips.row(0)[k], lower = lips.row(1)[k];
        const Point now = way(seen, upper, lower), usual = way(own, upper, lower), rest = way(other, upper, lower);
        const double open = std::min(std::max(now.y / std::max(usual.y, gap), 0.0), 1.0);
        apart(upper, lower, {now.x + open * (rest.x - usual.x), now.y + open * (rest.y - usual.y)});
    }
    const Hull hull = Hull::of<205>(seen, count);
    for (i64 k = 0; k < drawn.size(); ++k) {
        double *at = out + 2 * drawn.data[k];
        const Point p = hull.within({at[0], at[1]}, -inside);
        at[0] = p.x, at[1] = p.y;
    }
}
