// Included by each instruction set in a namespace of its own: numbers to bytes, and pictures that are read.

// The nearest whole number, halves to the even one, of |value| < 2^22; a loop of it is vectorised.
inline i32 nearest(float value) {
    const float shifted = value + 12582912.0f;  // 3 * 2^22: the last bit of the sum is 1
    i32 bits;
    std::memcpy(&bits, &shifted, 4);
    return bits - 0x4b400000;
}

inline u8 byte_of(float value) { return u8(nearest(std::min(std::max(value, 0.0f), 255.0f))); }

inline u8 byte_of(i32 value) { return u8(std::min(std::max(value, 0), 255)); }

inline u8 over_255(unsigned value) {  // value / 255 rounded to nearest, for value <= 255 * 255
    value += 128;
    return u8((value + (value >> 8)) >> 8);
}

// 0 up to the first value, 1 from the last, linear between them; the first may be the greater one.
inline float ramp(float value, double first, double last) {
    const float share = (value - float(first)) / float(last - first);
    return std::min(std::max(share, 0.0f), 1.0f);
}

// Four floats, of which every set of instructions makes the same.
#if defined(GUISE_X86)
struct F4 {
    __m128 v;
    F4() = default;
    F4(__m128 all) : v(all) {}
    explicit F4(float all) : v(_mm_set1_ps(all)) {}
    F4(float a, float b, float c, float d) : v(_mm_setr_ps(a, b, c, d)) {}
    static F4 load(const float *at) { return F4(_mm_loadu_ps(at)); }
    static F4 of_bytes(const u8 *at) {
        int word;
        std::memcpy(&word, at, 4);
#if defined(GUISE_SSE)
        return F4(_mm_cvtepi32_ps(_mm_cvtepu8_epi32(_mm_cvtsi32_si128(word))));
#else
        const __m128i none = _mm_setzero_si128();
        const __m128i half = _mm_unpacklo_epi8(_mm_cvtsi32_si128(word), none);
        return F4(_mm_cvtepi32_ps(_mm_unpacklo_epi16(half, none)));
#endif
    }
    void store(float *at) const { _mm_storeu_ps(at, v); }
    F4 whole() const { return F4(_mm_cvtepi32_ps(_mm_cvttps_epi32(v))); }  // towards zero
    void store_whole(i32 *at) const { _mm_storeu_si128(reinterpret_cast<__m128i *>(at), _mm_cvttps_epi32(v)); }
    template <int K> F4 all() const { return F4(_mm_shuffle_ps(v, v, K * 0x55)); }
    // Rounded to the nearest and clipped.
    std::uint32_t bytes() const {
        const __m128 clipped = _mm_min_ps(_mm_max_ps(v, _mm_setzero_ps()), _mm_set1_ps(255));
        const __m128i half = _mm_packs_epi32(_mm_cvtps_epi32(clipped), _mm_setzero_si128());
        return std::uint32_t(_mm_cvtsi128_si32(_mm_packus_epi16(half, half)));
    }
};
inline F4 operator+(F4 a, F4 b) { return _mm_add_ps(a.v, b.v); }
inline F4 operator-(F4 a, F4 b) { return _mm_sub_ps(a.v, b.v); }
inline F4 operator*(F4 a, F4 b) { return _mm_mul_ps(a.v, b.v); }
inline F4 least(F4 a, F4 b) { return _mm_min_ps(a.v, b.v); }
#else
struct F4 {
    float v[4];
    F4() = default;
    explicit F4(float all) : v{all, all, all, all} {}
    F4(float a, float b, float c, float d) : v{a, b, c, d} {}
    static F4 load(const float *at) { return F4(at[0], at[1], at[2], at[3]); }
    static F4 of_bytes(const u8 *at) { return F4(at[0], at[1], at[2], at[3]); }
    void store(float *at) const { std::memcpy(at, v, sizeof v); }
    F4 whole() const { return F4(float(i32(v[0])), float(i32(v[1])), float(i32(v[2])), float(i32(v[3]))); }
    void store_whole(i32 *at) const {
        for (int k = 0; k < 4; ++k) at[k] = i32(v[k]);
    }
    template <int K> F4 all() const { return F4(v[K]); }
    std::uint32_t bytes() const {
        std::uint32_t made = 0;
        for (int k = 0; k < 4; ++k) made |= std::uint32_t(byte_of(v[k])) << (8 * k);
        return made;
    }
};
inline F4 operator+(F4 a, F4 b) { return F4(a.v[0] + b.v[0], a.v[1] + b.v[1], a.v[2] + b.v[2], a.v[3] + b.v[3]); }
inline F4 operator-(F4 a, F4 b) { return F4(a.v[0] - b.v[0], a.v[1] - b.v[1], a.v[2] - b.v[2], a.v[3] - b.v[3]); }
inline F4 operator*(F4 a, F4 b) { return F4(a.v[0] * b.v[0], a.v[1] * b.v[1], a.v[2] * b.v[2], a.v[3] * b.v[3]); }
inline F4 least(F4 a, F4 b) {
    return F4(std::min(a.v[0], b.v[0]), std::min(a.v[1], b.v[1]), std::min(a.v[2], b.v[2]), std::min(a.v[3], b.v[3]));
}
#endif

// An index within an axis, as though it were mirrored about its first and its last entry.
inline i64 mirrored(i64 k, i64 size) {
    if (size == 1) return 0;
    while (k < 0 || k >= size) k = k < 0 ? -k : 2 * (size - 1) - k;
    return k;
}

// A Gaussian's weights from -reach to reach: four standard deviations, as many as OpenCV takes.
inline i64 gaussian_reach(double sigma) { return (i64(std::nearbyint(8 * sigma + 1)) | 1) / 2; }
inline void gaussian_weights(double sigma, i64 reach, float *out) {
    double *shares = memory<100, double>(2 * reach + 1), sum = 0;
    for (i64 k = -reach; k <= reach; ++k) sum += shares[reach + k] = std::exp(-0.5 * double(k * k) / (sigma * sigma));
    for (i64 k = 0; k <= 2 * reach; ++k) out[k] = float(shares[k] / sum);
}

// out = a plane (h, w) blurred by a Gaussian, mirrored at its border; out may be the plane itself.
inline void gaussian(const float *plane, i64 h, i64 w, double sigma, float *out) {
    const i64 reach = gaussian_reach(sigma);
    float *weights = memory<101, float>(2 * reach + 1), *down = memory<102, float>(h * w);
    gaussian_weights(sigma, reach, weights);
    weights += reach;
    float *line = memory<103, float>(w + 2 * reach) + reach;
    for (i64 y = 0; y < h; ++y) {
        float *to = down + y * w;
        for (i64 x = 0; x < w; ++x) to[x] = weights[0] * plane[y * w + x];
        for (i64 k = 1; k <= reach; ++k) {
            const float *above = plane + mirrored(y - k, h) * w, *below = plane + mirrored(y + k, h) * w, weight = weights[k];
            for (i64 x = 0; x < w; ++x) to[x] += weight * (above[x] + below[x]);
        }
    }
    for (i64 y = 0; y < h; ++y) {
        float *to = out + y * w;
        for (i64 x = -reach; x < w + reach; ++x) line[x] = down[y * w + mirrored(x, w)];
        for (i64 x = 0; x < w; ++x) to[x] = weights[0] * line[x];
        for (i64 k = 1; k <= reach; ++k) {
            const float weight = weights[k];
            for (i64 x = 0; x < w; ++x) to[x] += weight * (line[x - k] + line[x + k]);
        }
    }
}

// Out (2 h, 2 w): a plane stretched bilinearly, beyond its border as at it.
inline void doubled(const float *plane, i64 h, i64 w, float *out) {
    float *line = memory<104, float>(w + 2) + 1;
    for (i64 y = 0; y < 2 * h; ++y, out += 2 * w) {
        const i64 near = y / 2, far = std::min(std::max(near + (y % 2 ? 1 : -1), i64(0)), h - 1);
        const float *here = plane + near * w, *there = plane + far * w;
        for (i64 x = 0; x < w; ++x) line[x] = 0.75f * here[x] + 0.25f * there[x];
        line[-1] = line[0], line[w] = line[w - 1];
        for (i64 x = 0; x < w; ++x) {
            out[2 * x] = 0.75f * line[x] + 0.25f * line[x - 1];
            out[2 * x + 1] = 0.75f * line[x] + 0.25f * line[x + 1];
        }
    }
}

// A picture (h, w, 3) that is read by cubic convolution (Keys, a = -0.75), beyond its border as at it.
struct CubicPicture {
    Array<const u8> picture;
    i64 height, width;

    explicit CubicPicture(Array<const u8> given) : picture(given), height(given.shape[0]), width(given.shape[1]) {
        require(given.shape[2] == 3 && given.axes == 3 && given.size() > 0, "a picture must be (h, w, 3)");
        require(width < (1 << 24) && height < (1 << 24), "a picture must have fewer pixels");
    }

    // Colour at x, y into out (4,), the last of it without meaning.
    void read(float x, float y, float *out) const {
        const float bx = bounded(x, width), by = bounded(y, height);
        const float fx = std::floor(bx), fy = std::floor(by);
        const i64 left = i64(fx) - 1, top = i64(fy) - 1;
        if (left >= 0 && top >= 0 && left + 6 <= width && top + 4 <= height) {
            const u8 *at = picture.row(top) + 3 * left;
            sum(at, at + picture.stride, at + 2 * picture.stride, at + 3 * picture.stride, bx - fx, by - fy, out);
            return;
        }
        u8 texels[52] = {};
        for (i64 j = 0; j < 4; ++j) {
            const u8 *line = picture.row(held(top + j, height));
            for (i64 k = 0; k < 4; ++k) std::memcpy(texels + 12 * j + 3 * k, line + 3 * held(left + k, width), 3);
        }
        sum(texels, texels + 12, texels + 24, texels + 36, bx - fx, by - fy, out);
    }

  private:
    static float bounded(float at, i64 size) {
        return at > -3 ? (at < float(size + 2) ? at : float(size + 2)) : -3;
    }
    static i64 held(i64 k, i64 size) { return k < 0 ? 0 : k >= size ? size - 1 : k; }

    // Weights of four texels about a place that lies beyond the second by a share x in [0, 1): ((a x + b) x + c) x + d.
    static constexpr float WEIGHTS[4][4] = {
        {-0.75f, 1.25f, -1.25f, 0.75f}, {1.5f, -2.25f, 1.5f, -0.75f}, {-0.75f, 0, 0.75f, 0}, {0, 1, 0, 0}};

    static constexpr float WHOLE = 16384;  // down a column weights are whole: sums of bytes are exact, and quick

#if defined(GUISE_SSE)
    static __m128 weights(float share) {
        const __m128 x = _mm_set1_ps(share);
        __m128 sum = _mm_loadu_ps(WEIGHTS[0]);
        for (int k = 1; k < 4; ++k) sum = _mm_add_ps(_mm_mul_ps(sum, x), _mm_loadu_ps(WEIGHTS[k]));
        return sum;
    }
    template <int K> static __m128 all(__m128 values) { return _mm_shuffle_ps(values, values, 0x55 * K); }
    static __m128i sixteen(const u8 *at) { return _mm_loadu_si128(reinterpret_cast<const __m128i *>(at)); }
    static void sum(const u8 *p, const u8 *q, const u8 *r, const u8 *s, float x, float y, float *out) {
        const __m128 across = weights(x);
        const __m128i whole = _mm_cvtps_epi32(_mm_mul_ps(weights(y), _mm_set1_ps(WHOLE)));
        const __m128i down = _mm_packs_epi32(whole, whole), none = _mm_setzero_si128();
        const __m128i upper = _mm_shuffle_epi32(down, 0), lower = _mm_shuffle_epi32(down, 0x55);
        const __m128i a = sixteen(p), b = sixteen(q), c = sixteen(r), d = sixteen(s);
        const __m128i ab = _mm_unpacklo_epi8(a, b), cd = _mm_unpacklo_epi8(c, d);
        const auto pair = [&](__m128i one, __m128i other) {
            return _mm_castps_si128(_mm_cvtepi32_ps(_mm_add_epi32(_mm_madd_epi16(one, upper), _mm_madd_epi16(other, lower))));
        };
        const __m128i column[] = {
            pair(_mm_unpacklo_epi8(ab, none), _mm_unpacklo_epi8(cd, none)),
            pair(_mm_unpackhi_epi8(ab, none), _mm_unpackhi_epi8(cd, none)),
            pair(_mm_unpacklo_epi8(_mm_unpackhi_epi8(a, b), none), _mm_unpacklo_epi8(_mm_unpackhi_epi8(c, d), none))};
        const __m128 first = _mm_castsi128_ps(column[0]);
        const __m128 second = _mm_castsi128_ps(_mm_alignr_epi8(column[1], column[0], 12));
        const __m128 third = _mm_castsi128_ps(_mm_alignr_epi8(column[2], column[1], 8));
        const __m128 fourth = _mm_castsi128_ps(_mm_srli_si128(column[2], 4));
        const __m128 left = _mm_add_ps(_mm_mul_ps(first, all<0>(across)), _mm_mul_ps(second, all<1>(across)));
        const __m128 right = _mm_add_ps(_mm_mul_ps(third, all<2>(across)), _mm_mul_ps(fourth, all<3>(across)));
        _mm_storeu_ps(out, _mm_mul_ps(_mm_add_ps(left, right), _mm_set1_ps(1 / WHOLE)));
    }
#else
    static void sum(const u8 *p, const u8 *q, const u8 *r, const u8 *s, float x, float y, float *out) {
        float across[4], column[12];
        int down[4];
        for (int k = 0; k < 4; ++k) {
            across[k] = ((WEIGHTS[0][k] * x + WEIGHTS[1][k]) * x + WEIGHTS[2][k]) * x + WEIGHTS[3][k];
            const float weight = ((WEIGHTS[0][k] * y + WEIGHTS[1][k]) * y + WEIGHTS[2][k]) * y + WEIGHTS[3][k];
            down[k] = nearest(weight * WHOLE);
        }
        for (int k = 0; k < 12; ++k) column[k] = float(down[0] * p[k] + down[1] * q[k] + down[2] * r[k] + down[3] * s[k]);
        for (int k = 0; k < 3; ++k) {
            const float left = column[k] * across[0] + column[3 + k] * across[1];
            const float right = column[6 + k] * across[2] + column[9 + k] * across[3];
            out[k] = (left + right) * (1 / WHOLE);
        }
    }
#endif
};
