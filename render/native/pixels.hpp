// Included by each instruction set in a namespace of its own: numbers to bytes.

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
#else
struct F4 {
    float v[4];
    F4() = default;
    explicit F4(float all) : v{all, all, all, all} {}
    F4(float a, float b, float c, float d) : v{a, b, c, d} {}
    static F4 load(const float *at) { return F4(at[0], at[1], at[2], at[3]); }
    static F4 of_bytes(const u8 *at) { return F4(at[0], at[1], at[2], at[3]); }
    void store(float *at) const { std::memcpy(at, v, sizeof v); }
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
#endif
