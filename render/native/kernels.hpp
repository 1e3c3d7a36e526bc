// The kernels, once for each instruction set they are compiled for; all of them give the same bytes.

#pragma once

#include "arrays.hpp"

namespace guise {

// Each has a NumPy twin of the same name, which says what it does: look for `@kernel` in the Python code.
struct Kernels {
    void (*composite)(Array<const u8> texture, Array<const u8> alpha, Array<const double> snapped,
                      Array<const i32> triangles, Array<const double> grid, double opacity, Array<u8> target);
};

// Null where the compiler or the processor lacks the instruction set.
const Kernels *plain_kernels();
const Kernels *sse41_kernels();
const Kernels *avx2_kernels();

}  // namespace guise
