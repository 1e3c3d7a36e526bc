// Included by each instruction set in a namespace of its own: points of faces, and bilinear samples of pictures.

// Sums have eight or sixteen parts that are added in a fixed order, so that all instruction sets give the same.
template <class T> T total(const T (&part)[8]) {
    return ((part[0] + part[4]) + (part[1] + part[5])) + ((part[2] + part[6]) + (part[3] + part[7]));
}
inline float dot(const float *a, const float *b, i64 count) {
    float part[8] = {}, other[8] = {};
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
        x = near(x, width), y = near(y, height);
        const int left = floored(x), top = floored(y);
        return {inside(left, width), inside(left + 1, width), inside(top, height) * stride,
                inside(top + 1, height) * stride, x - float(left), y - float(top)};
    }
    float at(float x, float y) const {
        const Cell c = cell(x, y);
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
    require(points.shape[1] == 2 && points.axes == 2 && points.stride == 2, "points must be (v, 2)");
    const Mesh mesh(vertices, weights, points.shape[0]);
    require(places.shape[0] == mesh.places && places.shape[1] == 2 && places.axes == 2 && places.stride == 2, "places must be (n, 2)");
    mesh.lay(floats<200>(points.data, points.size()), places.data);
}
