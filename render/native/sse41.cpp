// For x86-64 with SSE4.1.

#include "standard.hpp"

#ifdef GUISE_X86
#ifdef __clang__
#pragma clang attribute push(__attribute__((target("sse4.1"))), apply_to = function)
#else
#pragma GCC push_options
#pragma GCC target("sse4.1")
#endif
#define GUISE_NAMESPACE sse41
#define GUISE_SSE
#include "implementation.hpp"
#ifdef __clang__
#pragma clang attribute pop
#else
#pragma GCC pop_options
#endif

const guise::Kernels *guise::sse41_kernels() { return __builtin_cpu_supports("sse4.1") ? &sse41::KERNELS : nullptr; }
#else
const guise::Kernels *guise::sse41_kernels() { return nullptr; }
#endif
