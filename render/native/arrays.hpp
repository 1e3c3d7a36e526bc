// What a kernel is given: views of NumPy's arrays, and numbers.

#pragma once

#include <cstddef>
#include <cstdint>

namespace guise {

using u8 = std::uint8_t;
using u16 = std::uint16_t;
using i32 = std::int32_t;
using i64 = std::int64_t;

// A C-contiguous array, or one whose first axis alone has a stride of its own, as a part of a picture has.
template <class T> struct Array {
    T *data;
    i64 shape[4];  // 1 beyond its axes
    i64 axes;
    i64 stride;  // elements from one entry of the first axis to the next

    i64 size() const { return shape[0] * shape[1] * shape[2] * shape[3]; }
    T *row(i64 y) const { return data + y * stride; }
};

}  // namespace guise
