// Before any `#pragma GCC target`: what the standard library inlines must run on every processor.

#pragma once

#include <algorithm>
#include <cmath>
#include <cstring>
#include <limits>
#include <stdexcept>
#include <utility>
#include <vector>

#include "kernels.hpp"

#if (defined(__GNUC__) || defined(__clang__)) && (defined(__x86_64__) || defined(__i386__))
#define GUISE_X86
#include <immintrin.h>
#endif
