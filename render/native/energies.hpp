// Included by each instruction set in a namespace of its own: how sharp and how grainy a picture is at some places.

// Brightness about pixels of a picture (h, w, 3), mirrored at its border.
struct Patches {
    Array<const u8> picture;
    i64 reach, side;
    float *values;  // (side, side), and some more that may be read

    Patches(Array<const u8> picture, i64 reach)
        : picture(picture), reach(reach), side(2 * reach + 1), values(memory<141, float>(side * side + 8)) {}

    // The patch about the pixel nearest to a place, or none.
    bool read(float place_x, float place_y) const {
        const i64 h = picture.shape[0], w = picture.shape[1];
        if (!(place_x > -1 && place_y > -1 && place_x < float(w) && place_y < float(h))) return false;
        const i64 x = nearest(place_x), y = nearest(place_y);
        if (x < 0 || y < 0 || x >= w || y >= h) return false;
        const bool inner = x >= reach && x + reach < w;
        for (i64 j = 0; j < side; ++j) {
            const u8 *line = picture.row(mirrored(y - reach + j, h)), *at = line + 3 * (x - reach);
            float *out = values + side * j;
            if (inner) {
                for (i64 k = 0; k < side; ++k) out[k] = float(at[3 * k]);
            } else {
                for (i64 k = 0; k < side; ++k) out[k] = float(line[3 * mirrored(x - reach + k, w)]);
            }
        }
        return true;
    }
};

inline void check_energies(Array<const u8> picture, Array<const float> places, double sigma, Array<float> energies) {
    require(picture.axes == 3 && picture.shape[2] == 3 && picture.size() > 0, "picture must be (h, w, 3)");
    require(picture.shape[0] < (1 << 22) && picture.shape[1] < (1 << 22), "picture must have fewer pixels");
    require(places.axes == 2 && places.shape[1] == 2 && places.stride == 2, "places must be (n, 2)");
    require(energies.axes == 1 && energies.stride == 1 && energies.shape[0] == places.shape[0], "energies must be (n,)");
    require(sigma > 0 && sigma < 8, "sigma must be positive, and less than 8 pixels");
}

// Four sums of values at steps about them, by a Gaussian's weights.
inline F4 blurred(const float *at, i64 step, const float *weights, i64 reach) {
    F4 sum = F4(weights[reach]) * F4::load(at);
    for (i64 k = 1; k <= reach; ++k) sum = sum + F4(weights[reach + k]) * (F4::load(at - step * k) + F4::load(at + step * k));
    return sum;
}

i64 gradient_at(Array<const u8> picture, Array<const float> places, double sigma, Array<float> energies) {
    check_energies(picture, places, sigma, energies);
    const i64 blur = gaussian_reach(sigma), side = 2 * blur + 3;
    float *weights = memory<142, float>(2 * blur + 1), *lines = memory<143, float>(4 * side);
    gaussian_weights(sigma, blur, weights);
    const Patches patches(picture, blur + 1);
    i64 count = 0;
    for (i64 n = 0; n < places.shape[0]; ++n) {
        if (!patches.read(places.data[2 * n], places.data[2 * n + 1])) continue;
        for (i64 j = 0; j < side; ++j) blurred(patches.values + side * j + blur, 1, weights, blur).store(lines + 4 * j);
        float levels[12];
        for (i64 j = 0; j < 3; ++j) blurred(lines + 4 * (blur + j), 4, weights, blur).store(levels + 4 * j);
        i32 luma[9];  // whole levels of the pixel and those about it
        for (i64 k = 0; k < 9; ++k) luma[k] = nearest(levels[4 * (k / 3) + k % 3]);
        const i32 *l = luma;
        const i32 along = (l[2] - l[0]) + 2 * (l[5] - l[3]) + (l[8] - l[6]);
        const i32 down = (l[6] - l[0]) + 2 * (l[7] - l[1]) + (l[8] - l[2]);
        energies.data[count++] = float(along * along + down * down) / 64;
    }
    return count;
}

i64 grain_at(Array<const u8> picture, Array<const float> places, double sigma, i64 box, Array<float> energies) {
    check_energies(picture, places, sigma, energies);
    require(box > 0 && box < 100 && box % 2 == 1, "box must be odd, and less than 100 pixels");
    const i64 blur = gaussian_reach(sigma), reach = blur + box / 2, side = 2 * reach + 1;
    const i64 wide = (box + 3) / 4 * 4;  // what lies beyond the box does not count
    float *weights = memory<142, float>(2 * blur + 1), *lines = memory<143, float>(side * wide + wide), *sums = lines + side * wide;
    gaussian_weights(sigma, blur, weights);
    const Patches patches(picture, reach);
    i64 count = 0;
    for (i64 n = 0; n < places.shape[0]; ++n) {
        if (!patches.read(places.data[2 * n], places.data[2 * n + 1])) continue;
        for (i64 j = 0; j < side; ++j) {
            const float *line = patches.values + side * j + blur;
            for (i64 x = 0; x < wide; x += 4) blurred(line + x, 1, weights, blur).store(lines + wide * j + x);
        }
        for (i64 x = 0; x < wide; x += 4) {
            F4 sum(0.0f);
            for (i64 y = blur; y < blur + box; ++y) {
                const F4 band = F4::load(patches.values + side * y + blur + x) - blurred(lines + wide * y + x, wide, weights, blur);
                sum = sum + band * band;
            }
            sum.store(sums + x);
        }
        float total = 0;
        for (i64 x = 0; x < box; ++x) total += sums[x];
        energies.data[count++] = total / float(box * box);
    }
    return count;
}
