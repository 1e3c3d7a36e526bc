// Included by each instruction set in a namespace of its own: the face's texture, its light, and its picture.

constexpr i64 MODES_AT_ONCE = 4;

// Rows of halves, none of which is infinite or not a number, and by how much each counts.
struct Halves {
    const u16 *rows[MODES_AT_ONCE];
    float amounts[MODES_AT_ONCE];
};

// sum := sum + the weighted rows from `start` on, one after the other; meanwhile those that are read next are fetched.
inline void add_halves(const Halves &those, const Halves &next, i64 start, float *sum, i64 count) {
    i64 i = 0;
#if defined(GUISE_AVX2)
    __m256 amounts[MODES_AT_ONCE];
    for (i64 k = 0; k < MODES_AT_ONCE; ++k) amounts[k] = _mm256_set1_ps(those.amounts[k]);
    for (; i + 32 <= count; i += 32) {
        for (const u16 *row : next.rows) _mm_prefetch(reinterpret_cast<const char *>(row + start + i), _MM_HINT_T0);
        for (i64 j = i; j < i + 32; j += 8) {
            __m256 all = _mm256_loadu_ps(sum + j);
            for (i64 k = 0; k < MODES_AT_ONCE; ++k) {
                const __m128i halves = _mm_loadu_si128(reinterpret_cast<const __m128i *>(those.rows[k] + start + j));
                all = _mm256_add_ps(all, _mm256_mul_ps(amounts[k], _mm256_cvtph_ps(halves)));
            }
            _mm256_storeu_ps(sum + j, all);
        }
    }
#endif
    (void)next;
    for (; i < count; ++i) {
        for (i64 k = 0; k < MODES_AT_ONCE; ++k) {
            const u16 half = those.rows[k][start + i];
            const std::uint32_t bits = std::uint32_t(half & 0x7fff) << 13 | std::uint32_t(half & 0x8000) << 16;
            float value;
            std::memcpy(&value, &bits, 4);
            sum[i] += those.amounts[k] * (value * 0x1p112f);
        }
    }
}

void expressed(Array<const float> base, Array<const u16> matrix, Array<const float> away, Array<const float> factors,
               Array<float> out) {
    const i64 size = base.size(), modes = away.size();
    require(matrix.shape[0] == modes && matrix.shape[1] == size, "matrix must be (k, n)");
    require(out.size() == size && size == 3 * factors.size(), "base and out must be (3 n,), factors (n,)");
    Halves *groups = memory<26, Halves>(modes / MODES_AT_ONCE + 1);  // of modes that count
    i64 used = 0;
    for (i64 k = 0; k < modes; ++k) {
        if (away.data[k] != 0) {
            groups[used / MODES_AT_ONCE].rows[used % MODES_AT_ONCE] = matrix.row(k);
            groups[used / MODES_AT_ONCE].amounts[used % MODES_AT_ONCE] = away.data[k];
            ++used;
        }
    }
    for (; used % MODES_AT_ONCE; ++used) {  // the last is filled up with what counts nothing
        groups[used / MODES_AT_ONCE].rows[used % MODES_AT_ONCE] = groups[0].rows[0];
        groups[used / MODES_AT_ONCE].amounts[used % MODES_AT_ONCE] = 0;
    }
    const i64 last = used / MODES_AT_ONCE - 1;
    constexpr i64 BLOCK = 3 * 1024;
    float sum[BLOCK];
    for (i64 start = 0; start < size; start += BLOCK) {
        const i64 count = std::min(BLOCK, size - start);
        std::memcpy(sum, base.data + start, std::size_t(count) * sizeof(float));
        for (i64 g = 0; g <= last; ++g) {
            add_halves(groups[g], groups[std::min(g + 1, last)], start, sum, count);
        }
        const float *factor = factors.data + start / 3;
        float *made = out.data + start;
        for (i64 i = 0; i < count / 3; ++i) {
            for (int c = 0; c < 3; ++c) made[3 * i + c] = sum[3 * i + c] * factor[i];
        }
    }
}

void texel_sums(Array<const i64> corners, Array<const double> shares, Array<const float> values,
                Array<const float> weights, Array<float> sums) {
    const i64 count = weights.size(), planes = values.shape[1] + 1, cells = sums.shape[1] * sums.shape[2];
    require(corners.shape[0] == 4 && corners.shape[1] == count && corners.stride == count, "corners must be (4, t)");
    require(shares.shape[0] == 4 && shares.shape[1] == count && shares.stride == count, "shares must be (4, t)");
    require(values.shape[0] == count && values.axes == 2, "values must be (t, c)");
    require(sums.shape[0] == planes && sums.axes == 3, "sums must be (c + 1, h, w)");
    double *total = memory<24, double>(planes * cells), *value = memory<25, double>(planes);
    std::fill(total, total + planes * cells, 0.0);
    for (i64 t = 0; t < count; ++t) {
        for (i64 k = 0; k + 1 < planes; ++k) value[k] = values.row(t)[k];
        value[planes - 1] = 1;
        for (i64 corner = 0; corner < 4; ++corner) {
            const i64 cell = corners.row(corner)[t];
            require(cell >= 0 && cell < cells, "corners must lie in the cells");
            const double weight = shares.row(corner)[t] * double(weights.data[t]);
            for (i64 k = 0; k < planes; ++k) total[planes * cell + k] += weight * value[k];
        }
    }
    for (i64 k = 0; k < planes; ++k) {
        float *plane = sums.row(k);
        for (i64 cell = 0; cell < cells; ++cell) plane[cell] = float(total[planes * cell + k]);
    }
}

// A row of cells between two rows: gains and offsets of each cell side by side, four floats each.
inline void cells_between(Array<const float> cells, float v, float *row) {
    const i64 h = cells.shape[1], w = cells.shape[2];
    v = std::min(std::max(v, 0.0f), float(h - 1));
    const i64 y = std::min(i64(v), h - 2);
    const float share = v - float(y);
    for (i64 k = 0; k < 6; ++k) {
        const float *upper = cells.row(k) + y * w, *lower = upper + w;
        for (i64 x = 0; x < w; ++x) row[8 * x + k + k / 3] = upper[x] + (lower[x] - upper[x]) * share;
    }
}

void lit(Array<const float> texture, Array<const i64> pixels, i64 width, Array<const float> cells, double cell,
         Array<const i64> in_parts, Array<const float> shares, Array<const float> parts, Array<const float> to_stored,
         Array<float> planes) {
    const i64 count = pixels.size(), h = cells.shape[1], w = cells.shape[2], some = in_parts.size();
    require(texture.shape[0] == count && texture.shape[1] == 3 && texture.stride == 3, "texture must be (n, 3)");
    require(cells.shape[0] == 6 && cells.stride == h * w && h > 1 && w > 1, "cells must be (6, h, w)");
    require(shares.shape[0] == parts.shape[0] && shares.shape[1] == some && parts.shape[1] == 3,
            "shares must be (p, m) and parts (p, 3)");
    require(to_stored.shape[0] == 3 && to_stored.shape[1] == 4 && to_stored.stride == 4, "to_stored must be (3, 4)");
    require(planes.shape[0] == 3 && planes.shape[1] == count, "planes must be (3, n)");
    require(width > 0 && cell > 0, "width and cell must be above 0");
    float *row = memory<20, float>(8 * w), *share = memory<21, float>(width);
    i32 *first = memory<22, i32>(width);
    std::fill(row, row + 8 * w, 0.0f);
    for (i64 x = 0; x < width; ++x) {
        const float u = std::min(std::max(float(double(x) / cell), 0.0f), float(w - 1));
        first[x] = i32(std::min(i64(u), w - 2));
        share[x] = u - float(first[x]);
    }
    F4 columns[4];
    for (int k = 0; k < 4; ++k) columns[k] = F4(to_stored.data[k], to_stored.data[4 + k], to_stored.data[8 + k], 0);
    float *planes_of[3] = {planes.row(0), planes.row(1), planes.row(2)};
    i64 at_row = -1, part = 0;
    for (i64 n = 0; n < count; ++n) {
        const i64 pixel = pixels.data[n], y = pixel / width, x = pixel - y * width;
        require(pixel >= 0, "pixels must lie in the picture");
        if (y != at_row) {
            at_row = y;
            cells_between(cells, float(double(y) / cell), row);
        }
        const float *cells_at = row + 8 * first[x];
        const F4 between(share[x]);
        F4 gain = F4::load(cells_at), offset = F4::load(cells_at + 4);
        gain = gain + (F4::load(cells_at + 8) - gain) * between;
        offset = offset + (F4::load(cells_at + 12) - offset) * between;
        if (part < some && in_parts.data[part] == n) {
            float most = 0;
            F4 added(0);
            for (i64 p = 0; p < parts.shape[0]; ++p) {
                const float *rgb = parts.row(p), of = shares.row(p)[part];
                most = std::max(most, of);
                added = added + F4(rgb[0], rgb[1], rgb[2], 0) * F4(of);
            }
            gain = gain * F4(1 - most) + added;
            offset = offset * F4(1 - most);
            ++part;
        }
        const float *rgb = texture.data + 3 * n;
        const F4 light = gain * F4(rgb[0], rgb[1], rgb[2], 0) + offset;
        float stored[4];
        (columns[0] * light.all<0>() + columns[1] * light.all<1>() + columns[2] * light.all<2>() + columns[3]).store(stored);
        for (int k = 0; k < 3; ++k) planes_of[k][n] = stored[k];
    }
}

void scattered(Array<const float> planes, Array<const i64> pixels, Array<const i64> beside, Array<const i64> nearest,
               Array<u8> picture) {
    const i64 count = pixels.size(), size = picture.shape[0] * picture.shape[1];
    require(planes.shape[0] == 3 && planes.shape[1] == count, "planes must be (3, n)");
    require(picture.shape[2] == 3 && picture.stride == 3 * picture.shape[1], "picture must be (h, w, 3)");
    require(beside.size() == nearest.size(), "beside and nearest must be alike");
    u8 *bytes = memory<23, u8>(3 * count);
    for (i64 c = 0; c < 3; ++c) {
        for (i64 n = 0; n < count; ++n) bytes[c * count + n] = byte_of(planes.row(c)[n]);
    }
    for (i64 n = 0; n < count; ++n) {
        require(pixels.data[n] >= 0 && pixels.data[n] < size, "pixels must lie in the picture");
        u8 *out = picture.data + 3 * pixels.data[n];
        for (i64 c = 0; c < 3; ++c) out[c] = bytes[c * count + n];
    }
    for (i64 n = 0; n < beside.size(); ++n) {
        const i64 to = beside.data[n], from = nearest.data[n];
        require(to >= 0 && to < size && from >= 0 && from < size, "pixels must lie in the picture");
        for (int c = 0; c < 3; ++c) picture.data[3 * to + c] = picture.data[3 * from + c];
    }
}
