// Compiled once for each instruction set, after GUISE_NAMESPACE and the headers of its intrinsics.

namespace guise {
namespace GUISE_NAMESPACE {

inline void require(bool fits, const char *why) {
    if (!fits) throw std::invalid_argument(why);
}

// Memory of this thread that is kept from call to call; its values are what the last call left.
template <int Place, class T> T *memory(i64 size, const T &empty = T{}) {
    static thread_local std::vector<T> kept;
    if (i64(kept.size()) < size) kept.resize(std::size_t(size), empty);
    return kept.data();
}

#include "pixels.hpp"

#include "composite.hpp"
#include "energies.hpp"
#include "enlarging.hpp"
#include "folds.hpp"
#include "frame.hpp"
#include "geometry.hpp"
#include "irises.hpp"
#include "landmarks.hpp"
#include "openings.hpp"
#include "sampling.hpp"
#include "skin.hpp"
#include "solid.hpp"
#include "strips.hpp"
#include "texture.hpp"
#include "tracking.hpp"
#include "upright.hpp"

#define GUISE_SET(name) made.name = name;
constexpr Kernels KERNELS = [] {
    Kernels made{};
    GUISE_KERNELS(GUISE_SET)
    return made;
}();
#undef GUISE_SET

}  // namespace GUISE_NAMESPACE
}  // namespace guise
