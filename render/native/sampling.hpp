// Included by each instruction set in a namespace of its own: colours of a picture at points.

inline Plane<u8> plane_of(const Array<const u8> &array) { return {array.data, array.shape[1], array.shape[0], array.stride}; }

void sample_picture(Array<const u8> picture, Array<const float> points, Array<float> colours) {
    const i64 count = points.shape[0], parts = picture.shape[2];
    require_points(points, count, "points must be (n, 2)");
    require(picture.axes == 3 && picture.size() > 0, "picture must be (h, w, c)");
    require(colours.axes == 2 && colours.shape[0] == count && colours.shape[1] == parts && colours.stride == parts, "colours must be (n, c)");
    const Plane<u8> plane = plane_of(picture);
    for (i64 k = 0; k < count; ++k) {
        Plane<u8>::Cell cell = plane.cell(points.data[2 * k], points.data[2 * k + 1]);
        cell.x0 *= parts, cell.x1 *= parts;
        for (i64 c = 0; c < parts; ++c, ++cell.x0, ++cell.x1) colours.data[parts * k + c] = plane.at(cell);
    }
}

void sample_planes(Array<const u8> luma, Array<const u8> first, Array<const u8> second, Array<const float> points,
                   Array<const float> to_chroma, Array<const float> to_rgb, Array<float> colours) {
    const i64 count = points.shape[0];
    require_points(points, count, "points must be (n, 2)");
    require(luma.axes == 2 && luma.size() > 0, "luma must be (h, w)");
    require(first.axes == 2 && first.size() > 0, "first must be (h, w)");
    require(second.axes == 2 && second.shape[0] == first.shape[0] && second.shape[1] == first.shape[1], "second must be as first");
    require(to_chroma.axes == 1 && to_chroma.size() == 4 && to_chroma.stride == 1, "to_chroma must be (4,)");
    require(to_rgb.axes == 2 && to_rgb.shape[0] == 3 && to_rgb.shape[1] == 4 && to_rgb.stride == 4, "to_rgb must be (3, 4)");
    require(colours.axes == 2 && colours.shape[0] == count && colours.shape[1] == 3 && colours.stride == 3, "colours must be (n, 3)");
    const Plane<u8> bright = plane_of(luma), one = plane_of(first), other = plane_of(second);
    const float *place = to_chroma.data, *matrix = to_rgb.data;
    for (i64 k = 0; k < count; ++k) {
        const float x = points.data[2 * k], y = points.data[2 * k + 1];
        const float a = bright.at(bright.cell(x, y)), u = (x - place[2]) * place[0], v = (y - place[3]) * place[1];
        const float b = one.at(one.cell(u, v)), c = other.at(other.cell(u, v));
        for (int part = 0; part < 3; ++part) {
            const float *row = matrix + 4 * part;
            colours.data[3 * k + part] = row[0] * a + row[1] * b + row[2] * c + row[3];
        }
    }
}

void colour_planes(Array<const u8> picture, double middle, Array<float> planes) {
    const i64 height = picture.shape[0], width = picture.shape[1];
    require(picture.axes == 3 && picture.shape[2] == 3, "picture must be (h, w, 3)");
    require(planes.axes == 3 && planes.shape[0] == 3 && planes.shape[1] == height && planes.shape[2] == width,
            "planes must be (3, h, w)");
    const float less = float(middle);
    for (i64 y = 0; y < height; ++y) {
        const u8 *from = picture.row(y);
        float *to[3];
        for (i64 part = 0; part < 3; ++part) to[part] = planes.row(part) + y * width;
        i64 x = 0;
#if defined(GUISE_SSE)
        const __m128i first = _mm_setr_epi8(0, -1, -1, -1, 3, -1, -1, -1, 6, -1, -1, -1, 9, -1, -1, -1);
        const __m128 lower = _mm_set1_ps(less);
        for (; 3 * x + 18 <= 3 * width; x += 4) {  // of 16 bytes twelve are used, from each place on
            for (int part = 0; part < 3; ++part) {
                const __m128i bytes = _mm_loadu_si128(reinterpret_cast<const __m128i *>(from + 3 * x + part));
                const __m128 values = _mm_cvtepi32_ps(_mm_shuffle_epi8(bytes, first));
                _mm_storeu_ps(to[part] + x, _mm_sub_ps(values, lower));
            }
        }
#endif
        for (; x < width; ++x) {
            for (int part = 0; part < 3; ++part) to[part][x] = float(from[3 * x + part]) - less;
        }
    }
}

void sample_cells(Array<const double> points, Array<const i64> corners, Array<const float> weights,
                  Array<const float> depth, Array<const float> across, Array<const float> maps,
                  Array<const double> to_cells, Array<float> places, Array<float> shares) {
    const i64 layers = maps.shape[2];
    require_points(points, points.shape[0], "points must be (v, 2)");
    const Mesh mesh(corners, weights, points.shape[0]);
    const i64 count = mesh.places;
    require_points(places, count, "places must be (n, 2)");
    require(depth.size() == count && across.size() == 2, "depth must be (n,), and across (2,)");
    require(maps.axes == 3 && maps.size() > 0 && maps.stride == maps.shape[1] * layers, "maps must be (h, w, c)");
    require(to_cells.axes == 2 && to_cells.shape[0] == 2 && to_cells.shape[1] == 3 && to_cells.stride == 3, "to_cells must be (2, 3)");
    require(shares.axes == 2 && shares.shape[0] == layers && shares.shape[1] == count && shares.stride == count, "shares must be (c, n)");
    mesh.lay(floats<200>(points.data, points.size()), places.data);
    const Plane<float> plane{maps.data, maps.shape[1], maps.shape[0], maps.stride};
    float map[6], *out = shares.data;
    for (int k = 0; k < 6; ++k) map[k] = float(to_cells.data[k]);
    const float across_x = across.data[0], across_y = across.data[1];
    for (i64 k = 0; k < count; ++k) {
        float *place = places.data + 2 * k;
        place[0] += depth.data[k] * across_x, place[1] += depth.data[k] * across_y;
        const float x = (map[0] * place[0] + map[1] * place[1]) + map[2], y = (map[3] * place[0] + map[4] * place[1]) + map[5];
        Plane<float>::Cell cell = plane.cell(x, y);
        cell.x0 *= layers, cell.x1 *= layers;
        i64 c = 0;
        for (; c + 4 <= layers; c += 4, cell.x0 += 4, cell.x1 += 4) {
            const F4 a = F4::load(maps.data + cell.y0 + cell.x0), d = F4::load(maps.data + cell.y1 + cell.x0), along(cell.fx);
            const F4 upper = a + (F4::load(maps.data + cell.y0 + cell.x1) - a) * along;
            const F4 lower = d + (F4::load(maps.data + cell.y1 + cell.x1) - d) * along;
            float four[4];
            (upper + (lower - upper) * F4(cell.fy)).store(four);
            for (i64 j = 0; j < 4; ++j) out[(c + j) * count + k] = four[j];
        }
        for (; c < layers; ++c, ++cell.x0, ++cell.x1) out[c * count + k] = plane.at(cell);
    }
}
