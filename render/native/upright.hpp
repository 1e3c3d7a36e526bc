// Included by each instruction set in a namespace of its own: upright crops of faces.

// The part of a picture (h, w, c) that a crop needs as means of blocks, side by side, and where it begins.
struct Blocks {
    u8 *data;  // (height, width, parts), and four bytes more
    i64 width, height, parts;
    double corner_x, corner_y, across, down;  // pixels, of the first block and of each

    static constexpr i64 MOST = 256;  // pixels of a side, whose sums fit 16 bits
    struct Range {
        i64 low, blocks, side;
    };
    // Blocks of about so many pixels from one place to another of an axis.
    static Range range(double from, double to, i64 size, i64 factor) {
        i64 low = within(std::floor(from) - double(factor), size);
        low = std::min(low, std::max<i64>(size - factor, 0));
        const i64 high = std::min(std::max(within(std::ceil(to) + double(factor), size), low + 1), size);
        const i64 blocks = std::max<i64>((high - low) / factor, 1);
        return {low, blocks, std::min(factor, size - low)};
    }
    Blocks(const Array<const u8> &picture, Range x, Range y)
        : width(x.blocks), height(y.blocks), parts(picture.shape[2]), corner_x(double(x.low)), corner_y(double(y.low)),
          across(double(x.side)), down(double(y.side)) {
        const i64 count = width * x.side * parts;
        data = memory<250, u8>(width * height * parts + 4);
        u16 *sums = memory<251, u16>(count);
        for (i64 row = 0; row < height; ++row) {
            const u8 *from = picture.row(y.low + row * y.side) + x.low * parts;
            u8 *to = data + row * width * parts;
            if (x.side == 1 && y.side == 1) {
                std::copy(from, from + count, to);
                continue;
            }
            std::fill(sums, sums + count, u16(0));
            for (i64 line = 0; line < y.side; ++line, from += picture.stride) add(from, count, sums);
            average(sums, x.side, y.side, to);
        }
    }
    static void add(const u8 *from, i64 count, u16 *sums) {
        for (i64 k = 0; k < count; ++k) sums[k] = u16(sums[k] + from[k]);
    }
    void average(const u16 *sums, i64 side, i64 lines, u8 *to) const {
        if (side == 2 && lines == 2) {
            parts == 1 ? average<2, 1>(sums, 2, 4, to) : average<2, 3>(sums, 2, 4, to);
        } else if (side == 3) {
            parts == 1 ? average<3, 1>(sums, 3, 3 * lines, to) : average<3, 3>(sums, 3, 3 * lines, to);
        } else {
            parts == 1 ? average<0, 1>(sums, side, side * lines, to) : average<0, 3>(sums, side, side * lines, to);
        }
    }
    // Of sums over a side that is known or given; halves are rounded up in blocks of four, and to the even level else.
    template <int Side, int Parts> void average(const u16 *sums, i64 side, i64 pixels, u8 *to) const {
        const float over = float(1 / double(pixels));
        const i64 wide = Side ? Side : side;
        for (i64 k = 0; k < width; ++k) {
            for (int c = 0; c < Parts; ++c) {
                const u16 *from = sums + k * wide * Parts + c;
                std::uint32_t sum = 0;
                for (i64 x = 0; x < wide; ++x) sum += from[x * Parts];
                to[k * Parts + c] = Side == 2 ? u8((sum + 2) >> 2) : u8(nearest(float(sum) * over));
            }
        }
    }
    // Bilinear at a place in blocks, black beyond them.
    float outer(i64 x, i64 y, float fx, float fy, i64 c) const {
        const auto at = [&](i64 column, i64 row) {
            const bool is_inside = column >= 0 && row >= 0 && column < width && row < height;
            return is_inside ? float(data[(row * width + column) * parts + c]) : 0.0f;
        };
        const float upper = at(x, y) + (at(x + 1, y) - at(x, y)) * fx, lower = at(x, y + 1) + (at(x + 1, y + 1) - at(x, y + 1)) * fx;
        return upper + (lower - upper) * fy;
    }
    std::uint32_t colour(float x, float y) const {
        x = Plane<u8>::near(x, width), y = Plane<u8>::near(y, height);
        const int left = Plane<u8>::floored(x), top = Plane<u8>::floored(y);
        std::uint32_t made = 0;
        for (int c = 0; c < 3; ++c) made |= std::uint32_t(nearest(outer(left, top, x - float(left), y - float(top), parts == 1 ? 0 : c))) << (8 * c);
        return made;
    }
    bool holds(float x, float y) const { return x > 0 && y > 0 && x < float(width - 1) - 0.01f && y < float(height - 1) - 0.01f; }

    // Colours of a row of places, which begins at one and goes on by steps; within the blocks as grey, or in colour.
    template <int Copies> void greys(float x, float y, float step_x, float step_y, i64 count, u8 *out) const {
        constexpr i64 SIDE = 64;
        float along[SIDE], down[SIDE];
        i32 places[SIDE];
        u16 upper[SIDE], lower[SIDE];
        const int across = int(width);
        for (i64 start = 0; start < count; start += SIDE, out += Copies * SIDE) {
            const int some = int(std::min(SIDE, count - start));
            for (int k = 0; k < some; ++k) {
                const float u = x + step_x * float(int(start) + k), v = y + step_y * float(int(start) + k);
                const int left = int(u), top = int(v);
                places[k] = top * across + left, along[k] = u - float(left), down[k] = v - float(top);
            }
            for (int k = 0; k < some; ++k) {
                std::memcpy(upper + k, data + places[k], 2), std::memcpy(lower + k, data + places[k] + across, 2);
            }
            for (int k = 0; k < some; ++k) {
                const float a = float(upper[k] & 255), b = float(upper[k] >> 8), c = float(lower[k] & 255), d = float(lower[k] >> 8);
                const float first = a + (b - a) * along[k], second = c + (d - c) * along[k];
                places[k] = nearest(first + (second - first) * down[k]);
            }
            for (int k = 0; k < some; ++k) {
                for (int c = 0; c < Copies; ++c) out[Copies * k + c] = u8(places[k]);
            }
        }
    }
    void colours(float x, float y, float step_x, float step_y, i64 count, u8 *out) const {
        const int across = 3 * int(width);
        const auto at = [&](int k) {
            const float u = x + step_x * float(k), v = y + step_y * float(k);
            const int left = int(u), top = int(v);
            const u8 *from = data + top * across + 3 * left, *below = from + across;
            const F4 along(u - float(left)), a = F4::of_bytes(from), b = F4::of_bytes(from + 3), c = F4::of_bytes(below), d = F4::of_bytes(below + 3);
            const F4 first = a + (b - a) * along, second = c + (d - c) * along;
            return (first + (second - first) * F4(v - float(top))).bytes();
        };
        for (int k = 0; k + 1 < int(count); ++k, out += 3) {
            const std::uint32_t word = at(k);
            std::memcpy(out, &word, 4);  // the fourth byte is the next pixel's
        }
        const std::uint32_t last = at(int(count) - 1);
        std::memcpy(out, &last, 3);
    }
    template <int Copies> void row(float x, float y, float step_x, float step_y, i64 count, u8 *out) const {
        if (holds(x, y) && holds(x + step_x * float(count - 1), y + step_y * float(count - 1))) {
            parts == 1 ? greys<Copies>(x, y, step_x, step_y, count, out) : colours(x, y, step_x, step_y, count, out);
            return;
        }
        for (i64 k = 0; k < count; ++k, out += Copies) {
            const std::uint32_t word = colour(x + step_x * float(k), y + step_y * float(k));
            std::memcpy(out, &word, Copies);
        }
    }
};

// Out (h, w, copies): a crop of a picture of one part or of three, black beyond it; to_picture (2, 3) from its pixels.
template <int Copies> void cut_upright(Array<const u8> picture, const double *map, i64 height, i64 width, u8 *out) {
    double low[2], high[2];
    for (int axis = 0; axis < 2; ++axis) {
        const double *row = map + 3 * axis, x = row[0] * double(width), y = row[1] * double(height);
        const double first = row[2] - 0.5 * (row[0] + row[1]);
        low[axis] = first + std::min(x, 0.0) + std::min(y, 0.0), high[axis] = first + std::max(x, 0.0) + std::max(y, 0.0);
        require(std::isfinite(low[axis]) && std::isfinite(high[axis]), "to_picture must be finite");
    }
    const double step = std::hypot(map[0], map[3]);
    const i64 factor = step < 2 ? 1 : within(step, Blocks::MOST);
    const Blocks blocks(picture, Blocks::range(low[0], high[0], picture.shape[1], factor), Blocks::range(low[1], high[1], picture.shape[0], factor));
    // From the crop's pixels to blocks.
    float local[2][3];
    const double size[2] = {blocks.across, blocks.down}, corner[2] = {blocks.corner_x, blocks.corner_y};
    for (int axis = 0; axis < 2; ++axis) {
        for (int k = 0; k < 2; ++k) local[axis][k] = float(map[3 * axis + k] / size[axis]);
        local[axis][2] = float((map[3 * axis + 2] - corner[axis] + 0.5) / size[axis] - 0.5);
    }
    for (i64 y = 0; y < height; ++y) {
        const float at_x = local[0][1] * float(y) + local[0][2], at_y = local[1][1] * float(y) + local[1][2];
        blocks.row<Copies>(at_x, at_y, local[0][0], local[1][0], width, out + Copies * y * width);
    }
}

void upright_crop(Array<const u8> picture, Array<const double> to_picture, Array<u8> crop) {
    const i64 height = crop.shape[0], width = crop.shape[1], parts = picture.shape[2];
    require(picture.axes == 3 && (parts == 1 || parts == 3) && picture.size() > 0, "picture must be (h, w, 1) or (h, w, 3)");
    require(to_picture.axes == 2 && to_picture.shape[0] == 2 && to_picture.shape[1] == 3 && to_picture.stride == 3, "to_picture must be (2, 3)");
    require(crop.axes == 3 && crop.shape[2] == 3 && crop.size() > 0 && crop.stride == 3 * width, "crop must be (h, w, 3)");
    cut_upright<3>(picture, to_picture.data, height, width, crop.data);
}

void upright_planes(Array<const u8> luma, Array<const u8> first, Array<const u8> second, Array<const double> to_chroma,
                    Array<const float> to_rgb, Array<const double> to_picture, Array<u8> crop) {
    const i64 height = crop.shape[0], width = crop.shape[1], n = height * width;
    require(luma.axes == 2 && luma.size() > 0, "luma must be (h, w)");
    require(first.axes == 2 && first.size() > 0 && second.axes == 2 && second.size() > 0, "chroma must be (h, w)");
    require(to_chroma.axes == 1 && to_chroma.size() == 4 && to_chroma.stride == 1, "to_chroma must be (4,)");
    require(to_rgb.axes == 2 && to_rgb.shape[0] == 3 && to_rgb.shape[1] == 4 && to_rgb.stride == 4, "to_rgb must be (3, 4)");
    require(to_picture.axes == 2 && to_picture.shape[0] == 2 && to_picture.shape[1] == 3 && to_picture.stride == 3, "to_picture must be (2, 3)");
    require(crop.axes == 3 && crop.shape[2] == 3 && n > 0 && crop.stride == 3 * width, "crop must be (h, w, 3)");
    const double *map = to_picture.data, *to = to_chroma.data;
    const double cells[] = {map[0] * to[0], map[1] * to[0], (map[2] - to[2]) * to[0],
                            map[3] * to[1], map[4] * to[1], (map[5] - to[3]) * to[1]};
    u8 *bright = memory<252, u8>(3 * n), *one = bright + n, *other = one + n;
    cut_upright<1>(luma, map, height, width, bright);
    cut_upright<1>(first, cells, height, width, one);
    cut_upright<1>(second, cells, height, width, other);
    i32 *made = memory<253, i32>(n);
    for (int part = 0; part < 3; ++part) {
        const float *row = to_rgb.row(part), a = row[0], b = row[1], c = row[2], d = row[3];
        for (i64 k = 0; k < n; ++k) {
            const float value = ((a * float(bright[k]) + b * float(one[k])) + c * float(other[k])) + d;
            made[k] = nearest(std::min(std::max(value, 0.0f), 255.0f));
        }
        for (i64 k = 0; k < n; ++k) crop.data[3 * k + part] = u8(made[k]);
    }
}
