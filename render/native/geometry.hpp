// Included by each instruction set in a namespace of its own: points of faces, and bilinear samples of pictures.

// Sums have eight or sixteen parts that are added in a fixed order, so that all instruction sets give the same.
template <class T> T total(const T (&part)[8]) {
    return ((part[0] + part[4]) + (part[1] + part[5])) + ((part[2] + part[6]) + (part[3] + part[7]));
}
template <class T> T dot(const T *a, const T *b, i64 count) {
    T part[8] = {}, other[8] = {};
    i64 k = 0;
    for (; k + 16 <= count; k += 16) {
        for (int lane = 0; lane < 8; ++lane) part[lane] += a[k + lane] * b[k + lane];
        for (int lane = 0; lane < 8; ++lane) other[lane] += a[k + 8 + lane] * b[k + 8 + lane];
    }
    for (; k < count; ++k) part[k % 8] += a[k] * b[k];
    for (int lane = 0; lane < 8; ++lane) part[lane] += other[lane];
    return total(part);
}
inline float sum(const float *a, i64 count) {
    float part[8] = {};
    i64 k = 0;
    for (; k + 8 <= count; k += 8) {
        for (int lane = 0; lane < 8; ++lane) part[lane] += a[k + lane];
    }
    for (; k < count; ++k) part[k % 8] += a[k];
    return total(part);
}

// Values with zero mean and unit standard deviation, in place.
inline void normalise(float *values, i64 count) {
    const float middle = sum(values, count) / float(count);
    for (i64 k = 0; k < count; ++k) values[k] -= middle;
    const float over = std::sqrt(dot(values, values, count) / float(count)) + 1e-3f;
    for (i64 k = 0; k < count; ++k) values[k] /= over;
}

template <class T> void require_points(const Array<T> &points, i64 count, const char *why) {
    require(points.axes == 2 && points.shape[0] == count && points.shape[1] == 2 && points.stride == 2, why);
}

// The similarity x' = a x - b y + tx, y' = b x + a y + ty.
struct Similarity {
    double a, b, tx, ty;
    double scale() const { return std::hypot(a, b); }
    Point operator()(Point p) const { return {a * p.x - b * p.y + tx, b * p.x + a * p.y + ty}; }
    // The least-squares one between points (x, y), whose weights sum to 1.
    static Similarity between(const double *from, const double *to, const double *weights, i64 count) {
        Point first{}, second{};
        for (i64 k = 0; k < count; ++k) {
            first.x += weights[k] * from[2 * k], first.y += weights[k] * from[2 * k + 1];
            second.x += weights[k] * to[2 * k], second.y += weights[k] * to[2 * k + 1];
        }
        double along = 0, across = 0, extent = 0;
        for (i64 k = 0; k < count; ++k) {
            const double x = from[2 * k] - first.x, y = from[2 * k + 1] - first.y;
            const double u = to[2 * k] - second.x, v = to[2 * k + 1] - second.y;
            along += weights[k] * (x * u + y * v), across += weights[k] * (x * v - y * u);
            extent += weights[k] * (x * x + y * y);
        }
        const double a = along / extent, b = across / extent;
        return {a, b, second.x - (a * first.x - b * first.y), second.y - (b * first.x + a * first.y)};
    }
};

// Bilinear samples of a plane; what lies beyond it is as at its border.
template <class T> struct Plane {
    const T *data;
    i64 width, height, stride;

    struct Cell {
        i64 x0, x1, y0, y1;  // y as places of rows in the data
        float fx, fy;
    };
    static int floored(float value) {
        const int whole = int(value);
        return whole - (float(whole) > value);
    }
    static float near(float value, i64 size) {  // also of what isn't a number
        const float low = value > -1 ? value : -1;
        return low < float(size) ? low : float(size);
    }
    static i64 inside(i64 place, i64 size) { return place < 0 ? 0 : place >= size ? size - 1 : place; }
    Cell cell(float x, float y) const {
        if (x >= 0 && y >= 0 && x < float(width - 1) && y < float(height - 1)) {  // sooner than clipping what needs none
            const int left = int(x), top = int(y);
            return {left, left + 1, top * stride, top * stride + stride, x - float(left), y - float(top)};
        }
        x = near(x, width), y = near(y, height);
        const int left = floored(x), top = floored(y);
        return {inside(left, width), inside(left + 1, width), inside(top, height) * stride,
                inside(top + 1, height) * stride, x - float(left), y - float(top)};
    }
    float at(float x, float y) const { return at(cell(x, y)); }
    float at(const Cell &c) const {
        const float a = float(data[c.y0 + c.x0]), b = float(data[c.y0 + c.x1]);
        const float d = float(data[c.y1 + c.x0]), e = float(data[c.y1 + c.x1]);
        const float upper = a + (b - a) * c.fx, lower = d + (e - d) * c.fx;
        return upper + (lower - upper) * c.fy;
    }
};

// Where places of a mesh lie: each has three of the points (x, y), with weights.
struct Mesh {
    const i64 *vertices;   // (3, n)
    const float *weights;  // (3, n)
    i64 places;

    Mesh(const Array<const i64> &vertices, const Array<const float> &weights, i64 points)
        : vertices(vertices.data), weights(weights.data), places(vertices.shape[1]) {
        require(vertices.shape[0] == 3 && vertices.axes == 2 && vertices.stride == places, "vertices must be (3, n)");
        require(weights.shape[0] == 3 && weights.shape[1] == places && weights.stride == places, "weights must be (3, n)");
        std::uint64_t most = 0;
        for (i64 k = 0; k < 3 * places; ++k) most = std::max(most, std::uint64_t(vertices.data[k]));
        require(places == 0 || most < std::uint64_t(points), "vertices must name points");
    }
    void lay(const float *points, float *out) const {
        const i64 *a = vertices, *b = a + places, *c = b + places;
        const float *u = weights, *v = u + places, *w = v + places;
        for (i64 k = 0; k < places; ++k) {
            for (int axis = 0; axis < 2; ++axis) {
                out[2 * k + axis] = points[2 * a[k] + axis] * u[k] + points[2 * b[k] + axis] * v[k] + points[2 * c[k] + axis] * w[k];
            }
        }
    }
};

// Points as mesh places are computed from.
template <int Place> const float *floats(const double *values, i64 count) {
    float *made = memory<Place, float>(count);
    for (i64 k = 0; k < count; ++k) made[k] = float(values[k]);
    return made;
}

void mesh_positions(Array<const double> points, Array<const i64> vertices, Array<const float> weights, Array<float> places) {
    require_points(points, points.shape[0], "points must be (v, 2)");
    const Mesh mesh(vertices, weights, points.shape[0]);
    require_points(places, mesh.places, "places must be (n, 2)");
    mesh.lay(floats<200>(points.data, points.size()), places.data);
}

void planar_similarity(Array<const double> source, Array<const double> target, Array<const double> weights, Array<double> made) {
    const i64 count = weights.shape[0];
    require_points(source, count, "source must be (n, 2)");
    require_points(target, count, "target must be (n, 2)");
    require(weights.axes == 1 && weights.stride == 1, "weights must be (n,)");
    require(made.size() == 4 && made.axes == 1 && made.stride == 1, "made must be (4,)");
    const Similarity found = Similarity::between(source.data, target.data, weights.data, count);
    made.data[0] = found.a, made.data[1] = found.b, made.data[2] = found.tx, made.data[3] = found.ty;
}

// The convex hull of points, of which each edge has an outward unit normal.
struct Hull {
    struct Edge {
        double x, y, reach;  // the normal, and how far along it the edge lies
    };
    Edge *edges;
    i64 count = 0;

    // Of points (x, y) rounded to floats.
    template <int Place> static Hull of(const double *points, i64 n) {
        Point *sorted = memory<Place, Point>(n), *chain = memory<Place + 1, Point>(2 * n + 1);
        for (i64 k = 0; k < n; ++k) sorted[k] = {double(float(points[2 * k])), double(float(points[2 * k + 1]))};
        std::sort(sorted, sorted + n, [](Point a, Point b) { return a.x < b.x || (a.x == b.x && a.y < b.y); });
        i64 size = 0;
        const auto add = [&](Point p, i64 first) {
            while (size >= first + 2) {
                const Point a = chain[size - 2], b = chain[size - 1];
                if ((b.x - a.x) * (p.y - a.y) - (b.y - a.y) * (p.x - a.x) > 0) break;
                --size;
            }
            chain[size++] = p;
        };
        for (i64 k = 0; k < n; ++k) add(sorted[k], 0);
        const i64 lower = size - 1;
        for (i64 k = n - 2; k >= 0; --k) add(sorted[k], lower);
        Hull made;
        made.edges = memory<Place + 2, Edge>(2 * n + 1);
        for (i64 k = 0; size > 3 && k + 1 < size; ++k) {  // the last point is the first one again
            const double x = chain[k + 1].x - chain[k].x, y = chain[k + 1].y - chain[k].y;
            const double length = std::max(std::hypot(x, y), 1e-9);
            made.edges[made.count++] = {y / length, -x / length, (y * chain[k].x - x * chain[k].y) / length};
        }
        return made;
    }
    // A point that lies farther out than said, moved in across the edge that it is farthest beyond.
    Point within(Point p, double most) const {
        double farthest = -INFINITY;
        Edge edge{0, 0, 0};
        for (i64 k = 0; k < count; ++k) {
            const double beyond = p.x * edges[k].x + p.y * edges[k].y - edges[k].reach;
            if (beyond > farthest) farthest = beyond, edge = edges[k];
        }
        const double excess = std::max(farthest - most, 0.0);
        return {p.x - excess * edge.x, p.y - excess * edge.y};
    }
};

void relief_seen(Array<const double> points, Array<const i64> vertices, Array<const float> weights,
                 Array<const double> depth, Array<const double> across, double beyond, Array<double> seen) {
    const i64 count = points.shape[0];
    const Mesh mesh(vertices, weights, count);
    require_points(points, count, "points must be (v, 2)");
    require(count > 0 && depth.axes == 1 && depth.size() == mesh.places && depth.stride == 1, "depth must be (k,)");
    require(across.axes == 1 && across.size() == 2 && across.stride == 1, "across must be (2,)");
    require_points(seen, count + mesh.places, "seen must be (v + k, 2)");
    std::copy(points.data, points.data + 2 * count, seen.data);
    const double x = across.data[0], y = across.data[1];
    const bool turned = x != 0 || y != 0;
    const Hull hull = turned ? Hull::of<201>(points.data, count) : Hull{};
    double low = INFINITY, high = -INFINITY;
    for (i64 k = 0; k < count; ++k) low = std::min(low, points.data[2 * k + 1]), high = std::max(high, points.data[2 * k + 1]);
    double *out = seen.data + 2 * count;
    for (i64 k = 0; k < mesh.places; ++k, out += 2) {
        Point at{depth.data[k] * x, depth.data[k] * y};
        for (int corner = 0; corner < 3; ++corner) {
            const double *from = points.data + 2 * mesh.vertices[corner * mesh.places + k];
            const double weight = mesh.weights[corner * mesh.places + k];
            at.x += weight * from[0], at.y += weight * from[1];
        }
        if (hull.count) at = hull.within(at, beyond * (high - low));
        out[0] = at.x, out[1] = at.y;
    }
}
