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

// Sums of values, times weights, in the cells around texels, side by side for each cell, in memory of this thread.
// corners, shares : (4, t), see the twin of `texel_sums`.   read : weight of a texel, and its values (planes,).
template <class F>
inline double *cell_sums(Array<const i64> corners, Array<const double> shares, i64 planes, i64 cells, const F &read) {
    const i64 count = corners.shape[1];
    require(corners.axes == 2 && corners.shape[0] == 4 && corners.stride == count, "corners must be (4, t)");
    require(shares.shape[0] == 4 && shares.shape[1] == count && shares.stride == count, "shares must be (4, t)");
    double *total = memory<24, double>(planes * cells), *value = memory<25, double>(planes);
    std::fill(total, total + planes * cells, 0.0);
    for (i64 t = 0; t < count; ++t) {
        const double counts = read(t, value);
        for (i64 corner = 0; corner < 4; ++corner) {
            const i64 cell = corners.data[corner * count + t];
            require(cell >= 0 && cell < cells, "corners must lie in the cells");
            const double weight = shares.data[corner * count + t] * counts;
            double *to = total + planes * cell;
            for (i64 k = 0; k < planes; ++k) to[k] += weight * value[k];
        }
    }
    return total;
}

void texel_sums(Array<const i64> corners, Array<const double> shares, Array<const float> values,
                Array<const float> seen, Array<const i64> chosen, Array<const float> weights, Array<float> sums) {
    const i64 count = corners.shape[1], known = values.shape[1], planes = known + seen.shape[1] + 1;
    const i64 cells = sums.shape[1] * sums.shape[2], all = seen.shape[0];
    require(values.axes == 2 && values.shape[0] == count, "values must be (t, c)");
    require(seen.axes == 2 && weights.axes == 1 && weights.shape[0] == all, "seen must be (n, d), and weights (n,)");
    require(chosen.axes == 1 && chosen.shape[0] == count, "chosen must be (t,)");
    require(sums.axes == 3 && sums.shape[0] == planes, "sums must be (c + d + 1, h, w)");
    const double *total = cell_sums(corners, shares, planes, cells, [&](i64 t, double *value) {
        const i64 at = chosen.data[t];
        require(at >= 0 && at < all, "chosen must name what is seen");
        for (i64 k = 0; k < known; ++k) value[k] = values.row(t)[k];
        for (i64 k = known; k + 1 < planes; ++k) value[k] = seen.row(at)[k - known];
        value[planes - 1] = 1;
        return double(weights.data[at]);
    });
    for (i64 k = 0; k < planes; ++k) {
        float *plane = sums.row(k);
        for (i64 cell = 0; cell < cells; ++cell) plane[cell] = float(total[planes * cell + k]);
    }
}

// The sum of a plane: eight sums of every eighth number, and theirs.
inline double plane_sum(const float *plane, i64 n) {
    double part[8] = {};
    for (i64 k = 0; k < n; ++k) part[k & 7] += double(plane[k]);
    return ((part[0] + part[1]) + (part[2] + part[3])) + ((part[4] + part[5]) + (part[6] + part[7]));
}

void move_light(Array<const float> sums, Array<const float> at_rest, Array<const float> tone,
                Array<const double> limits, Array<const float> kept, double share, Array<float> light,
                Array<float> change) {
    const i64 n = light.shape[1] * light.shape[2];
    const auto planes = [n](const auto &array, i64 count) { return array.shape[0] == count && array.size() == count * n; };
    require(light.axes == 3 && planes(light, 6) && light.stride == n && planes(kept, 6), "light must be (6, h, w)");
    require(planes(sums, 7) && planes(at_rest, 3), "sums must be (7, h, w), and at_rest (3, h, w)");
    require(tone.size() == 3 && change.size() == 3 && limits.size() == 3, "tone, limits and change must be (3,)");
    const float black = float(limits.data[0]);
    float *inverse = memory<27, float>(2 * n), *white = inverse + n, most = 0;
    for (i64 k = 0; k < n; ++k) inverse[k] = std::max(sums.row(6)[k], 1e-9f);
    for (i64 k = 0; k < n; ++k) most = std::max(most, white[k] = sums.row(4)[k] / inverse[k] + black);
    for (i64 k = 0; k < n && most > float(limits.data[1]); ++k) white[k] = ramp(white[k], limits.data[1], limits.data[2]);
    for (i64 c = 0; c < 3; ++c) {
        const float *own_sums = sums.row(c), *now_sums = sums.row(3 + c), *rest = at_rest.row(c), *last = kept.row(c);
        const float *last_offset = kept.row(3 + c), tint = tone.data[c], step = float(share);
        float *gain = light.row(c), *offset = light.row(3 + c);
        for (i64 k = 0; k < n; ++k) gain[k] = (now_sums[k] / inverse[k] + black) / (own_sums[k] / inverse[k] + black);
        for (i64 k = 0; k < n && most > float(limits.data[1]); ++k) {
            if (white[k] > 0) gain[k] *= std::pow((own_sums[k] / inverse[k] + black) / rest[k], white[k]);
        }
        for (i64 k = 0; k < n; ++k) gain[k] *= tint;
        const float moved = float(plane_sum(gain, n)) / std::max(float(plane_sum(last, n)), 1e-4f);
        change.data[c] = moved;
        for (i64 k = 0; k < n; ++k) {
            const float aim = gain[k], from = last[k] * moved, from_offset = last_offset[k] * moved;
            gain[k] = from + step * (aim - from);
            offset[k] = from_offset + step * (black * (aim - 1) - from_offset);
        }
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

// Out: lights (6, h, w) of a face whose skin (m,) has moved from where it was at rest, of gains and offsets like these.
inline void follow_skin(Array<const float> texture, Array<const float> light, Array<const i64> skin,
                        Array<const float> at_rest, Array<const i64> corners, Array<const double> corner_shares, float *out) {
    const i64 n = light.shape[1] * light.shape[2], some = skin.size();
    require(at_rest.size() == 3 * some && at_rest.stride == 3 && corners.shape[1] == some, "at_rest must be (m, 3)");
    const double *total = cell_sums(corners, corner_shares, 4, n, [&](i64 t, double *value) {
        require(skin.data[t] >= 0 && skin.data[t] < texture.shape[0], "skin must be in the texture");
        const float *now = texture.data + 3 * skin.data[t], *then = at_rest.data + 3 * t;
        for (int c = 0; c < 3; ++c) value[c] = double(now[c] - then[c]);
        value[3] = 1;
        return 1.0;
    });
    std::memcpy(out, light.data, std::size_t(6 * n) * sizeof(float));
    for (i64 k = 0; k < n; ++k) {
        const float weight = std::max(float(total[4 * k + 3]), 1.0f);
        for (i64 c = 0; c < 3; ++c) out[(3 + c) * n + k] -= out[c * n + k] * (float(total[4 * k + c]) / weight);
    }
}

void lit(Array<const float> texture, Array<const i64> pixels, i64 width, double cell, Array<const float> light,
         Array<const i64> skin, Array<const float> at_rest, Array<const i64> corners, Array<const double> corner_shares,
         Array<const i64> in_parts, Array<const float> shares, Array<const float> parts, Array<const float> to_stored,
         Array<float> planes) {
    const i64 count = pixels.size(), h = light.shape[1], w = light.shape[2], some = in_parts.size();
    require(texture.shape[0] == count && texture.shape[1] == 3 && texture.stride == 3, "texture must be (n, 3)");
    require(light.axes == 3 && light.shape[0] == 6 && light.stride == h * w && h > 1 && w > 1, "light must be (6, h, w)");
    require(shares.shape[0] == parts.shape[0] && shares.shape[1] == some && parts.shape[1] == 3,
            "shares must be (p, m) and parts (p, 3)");
    require(to_stored.shape[0] == 3 && to_stored.shape[1] == 4 && to_stored.stride == 4, "to_stored must be (3, 4)");
    require(planes.shape[0] == 3 && planes.shape[1] == count, "planes must be (3, n)");
    require(width > 0 && cell > 0, "width and cell must be above 0");
    float *followed = memory<28, float>(6 * h * w);
    follow_skin(texture, light, skin, at_rest, corners, corner_shares, followed);
    const Array<const float> cells{followed, {6, h, w, 1}, 3, h * w};
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
        const F4 made = gain * F4(rgb[0], rgb[1], rgb[2], 0) + offset;
        float stored[4];
        (columns[0] * made.all<0>() + columns[1] * made.all<1>() + columns[2] * made.all<2>() + columns[3]).store(stored);
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
