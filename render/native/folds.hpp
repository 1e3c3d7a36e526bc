// Included by each instruction set in a namespace of its own: where a mesh is squeezed, and where it turns over.

// Whether a point lies in a triangle that turns clockwise on the screen.
inline bool is_covered(Point at, const double *points, const i32 *corners) {
    for (int k = 0; k < 3; ++k) {
        const double *from = points + 2 * corners[k], *to = points + 2 * corners[(k + 1) % 3];
        if ((to[0] - from[0]) * (at.y - from[1]) < (to[1] - from[1]) * (at.x - from[0])) return false;
    }
    return true;
}

i64 find_folds(Array<const double> points, Array<const i32> triangles, Array<const double> to_edges,
               Array<const u8> closing, Array<const i64> ends, Array<const i64> sides, Array<const double> limits,
               Array<float> shares, Array<double> edges) {
    const i64 count = triangles.shape[0], pairs = ends.shape[0], known = points.shape[0];
    require(points.axes == 2 && points.shape[1] == 2 && points.stride == 2, "points must be (v, 2)");
    require(triangles.axes == 2 && triangles.shape[1] == 3 && triangles.stride == 3, "triangles must be (t, 3)");
    require(to_edges.size() == 4 * count && to_edges.stride == 4, "to_edges must be (t, 2, 2)");
    require(closing.size() == count && shares.size() == count, "closing and shares must be (t,)");
    require(ends.axes == 2 && ends.shape[1] == 2 && sides.shape[0] == pairs && sides.shape[1] == 2,
            "ends and sides must be (e, 2)");
    require(edges.size() == 4 * pairs && edges.stride == 4, "edges must be (e, 2, 2)");
    require(limits.size() == 4, "limits must be zoom, two of what is squeezed, and what is beyond");
    const double zoom = limits.data[0], first = limits.data[1], last = limits.data[2], reach = limits.data[3];
    const double *at = points.data;
    u8 *facing = memory<40, u8>(count);
    bool squeezed = false;
    for (i64 t = 0; t < count; ++t) {
        const i32 *corner = triangles.row(t);
        for (int k = 0; k < 3; ++k) require(corner[k] >= 0 && corner[k] < known, "triangles must name points");
        const double *p = at + 2 * corner[0], *q = at + 2 * corner[1], *r = at + 2 * corner[2], *to = to_edges.row(t);
        const double x1 = q[0] - p[0], x2 = r[0] - p[0], y1 = q[1] - p[1], y2 = r[1] - p[1];
        const double a = x1 * to[0] + x2 * to[2], b = x1 * to[1] + x2 * to[3];
        const double c = y1 * to[0] + y2 * to[2], d = y1 * to[1] + y2 * to[3];
        const double squares = a * a + b * b + c * c + d * d, area = a * d - b * c;
        const double narrow =
            (std::sqrt(std::max(squares + 2 * area, 0.0)) - std::sqrt(std::max(squares - 2 * area, 0.0))) / 2 / zoom;
        facing[t] = narrow > 0;
        const double share = std::min(std::max((first - narrow) / (first - last), 0.0), 1.0);
        shares.data[t] = closing.data[t] ? 0.0f : float(share);
        squeezed = squeezed || shares.data[t] > 0;
    }
    if (!squeezed) return -1;
    i64 found = 0;
    for (i64 e = 0; e < pairs; ++e) {
        const i64 *end = ends.row(e), *side = sides.row(e);
        require(end[0] >= 0 && end[0] < known && end[1] >= 0 && end[1] < known && side[0] >= 0 && side[0] < count &&
                    side[1] >= 0 && side[1] < count,
                "ends must name points, and sides triangles");
        if (facing[side[0]] == facing[side[1]]) continue;
        const double *one = at + 2 * end[0], *other = at + 2 * end[1];
        const i32 *front = triangles.row(side[facing[side[0]] ? 0 : 1]);
        const double x = (one[0] + other[0]) / 2, y = (one[1] + other[1]) / 2;
        double away_x = other[1] - one[1], away_y = one[0] - other[0];
        const double length = std::max(std::sqrt(away_x * away_x + away_y * away_y), 1e-6);
        double middle_x = 0, middle_y = 0;
        for (int k = 0; k < 3; ++k) {
            middle_x += at[2 * front[k]] / 3;
            middle_y += at[2 * front[k] + 1] / 3;
        }
        const double along = (x - middle_x) * away_x + (y - middle_y) * away_y;
        const double sign = reach / length * double((along > 0) - (along < 0));
        away_x *= sign;
        away_y *= sign;
        bool is_covered_twice = true;
        for (const double *corner : {one, other}) {
            bool is_one = false;
            for (i64 t = 0; t < count && !is_one; ++t) {
                is_one = facing[t] && is_covered({corner[0] + away_x, corner[1] + away_y}, at, triangles.row(t));
            }
            is_covered_twice = is_covered_twice && is_one;
        }
        if (!is_covered_twice) continue;
        double *out = edges.row(found++);
        out[0] = one[0], out[1] = one[1], out[2] = other[0], out[3] = other[1];
    }
    return found;
}
