// For any processor: what the compiler's default allows, SSE2 on x86-64 and NEON on aarch64.

#include "standard.hpp"

#define GUISE_NAMESPACE plain
#include "implementation.hpp"

const guise::Kernels *guise::plain_kernels() { return &plain::KERNELS; }
