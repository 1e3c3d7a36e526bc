// For x86-64 with AVX2; processors that have it read half floats (F16C), too.

#include "standard.hpp"

#ifdef GUISE_X86
#ifdef __clang__
#pragma clang attribute push(__attribute__((target("avx2,f16c"))), apply_to = function)
#else
#pragma GCC push_options
#pragma GCC target("avx2,f16c")
#endif
#define GUISE_NAMESPACE avx2
#define GUISE_SSE
#define GUISE_AVX2
#include "implementation.hpp"
#ifdef __clang__
#pragma clang attribute pop
#else
#pragma GCC pop_options
#endif

const guise::Kernels *guise::avx2_kernels() {
    return __builtin_cpu_supports("avx2") ? &avx2::KERNELS : nullptr;
}
#else
const guise::Kernels *guise::avx2_kernels() { return nullptr; }
#endif
