// guise.common._kernels: the kernels as functions of Python that release the interpreter's lock.

#define PY_SSIZE_T_CLEAN
#ifndef Py_LIMITED_API
#define Py_LIMITED_API 0x030b0000
#endif
#include <Python.h>

#include <stdexcept>
#include <string>
#include <tuple>
#include <type_traits>
#include <utility>

#include "kernels.hpp"

namespace {

using guise::Array;
using guise::i64;
using guise::Kernels;

const Kernels *active = nullptr;

// The letters of a type, and of those that are converted into it.
struct Letters {
    const char *same, *near, *name;
};
template <class T> Letters letters();
template <> Letters letters<guise::u8>() { return {"B?", "", "u1"}; }
template <> Letters letters<guise::u16>() { return {"He", "", ""}; }
template <> Letters letters<guise::i32>() { return {"il", "ilq", "i4"}; }
template <> Letters letters<i64>() { return {"lq", "ilq", "i8"}; }
template <> Letters letters<float>() { return {"f", "fd", "f4"}; }
template <> Letters letters<double>() { return {"d", "fd", "f8"}; }

struct Failed {};  // Python's error is set

// One argument, held for as long as the kernel runs.
template <class T> struct Given;

template <class T> struct Given<Array<T>> {
    Py_buffer buffer{};
    Array<T> value{};

    Given(PyObject *object, int place) {
        const int flags = std::is_const_v<T> ? PyBUF_RECORDS_RO : PyBUF_RECORDS;
        if (PyObject_GetBuffer(object, &buffer, flags) != 0) throw Failed{};
        try {
            if (std::is_const_v<T> && !fits()) copy(object);
            read(place);
        } catch (...) {
            PyBuffer_Release(&buffer);
            throw;
        }
    }
    Given(const Given &) = delete;
    ~Given() { PyBuffer_Release(&buffer); }

    using Plain = std::remove_const_t<T>;

    bool is(const char *allowed) const {
        const char *format = buffer.format;
        return format && format[0] && format[1] == 0 && std::string(allowed).find(format[0]) != std::string::npos;
    }
    bool is_same() const { return is(letters<Plain>().same) && buffer.itemsize == sizeof(T); }

    // Whether it can be read as it is: whole, or by rows of bytes, as those of a part of a picture.
    bool fits() const {
        if (!is_same()) return false;
        Py_ssize_t inner = sizeof(T);
        for (int axis = buffer.ndim - 1; axis >= (sizeof(T) == 1 ? 1 : 0); --axis) {
            if (buffer.shape[axis] > 1 && buffer.strides[axis] != inner) return false;
            inner *= buffer.shape[axis];
        }
        return true;
    }

    // An array of other numbers of the kind, or whose entries do not lie side by side, is copied.
    void copy(PyObject *object) {
        const Letters of = letters<Plain>();
        if (!is_same() && !is(of.near)) return;
        PyObject *numpy = PyImport_ImportModule("numpy");
        PyObject *made = numpy ? PyObject_CallMethod(numpy, "array", "Os", object, of.name[0] ? of.name : "f2") : nullptr;
        PyObject *whole = made ? PyObject_CallMethod(numpy, "ascontiguousarray", "O", made) : nullptr;
        Py_XDECREF(numpy);
        Py_XDECREF(made);
        if (!whole) throw Failed{};
        PyBuffer_Release(&buffer);
        const int found = PyObject_GetBuffer(whole, &buffer, PyBUF_RECORDS_RO);  // which keeps it
        Py_DECREF(whole);
        if (found != 0) throw Failed{};
    }

    void read(int place) {
        if (!is_same() || buffer.ndim < 1 || buffer.ndim > 4) {
            PyErr_Format(PyExc_TypeError, "argument %d has the wrong type of numbers", place);
            throw Failed{};
        }
        value.data = static_cast<T *>(buffer.buf);
        value.axes = buffer.ndim;
        Py_ssize_t inner = sizeof(T);
        for (int axis = 3; axis >= buffer.ndim; --axis) value.shape[axis] = 1;
        for (int axis = buffer.ndim - 1; axis >= 0; --axis) {
            value.shape[axis] = buffer.shape[axis];
            const bool dense = buffer.shape[axis] <= 1 || buffer.strides[axis] == inner;
            const bool first = axis == 0 && buffer.strides[0] % Py_ssize_t(sizeof(T)) == 0;
            if (!dense && !first) {
                PyErr_Format(PyExc_ValueError, "argument %d must hold its entries side by side", place);
                throw Failed{};
            }
            value.stride = dense && axis == 0 ? inner / Py_ssize_t(sizeof(T)) : buffer.strides[0] / Py_ssize_t(sizeof(T));
            inner *= buffer.shape[axis];
        }
        if (inner == 0) value.stride = value.shape[1] * value.shape[2] * value.shape[3];  // NumPy's says nothing
    }
};

template <> struct Given<double> {
    double value;
    Given(PyObject *object, int) : value(PyFloat_AsDouble(object)) {
        if (PyErr_Occurred()) throw Failed{};
    }
};

template <> struct Given<i64> {
    i64 value;
    Given(PyObject *object, int) : value(PyLong_AsLongLong(object)) {
        if (PyErr_Occurred()) throw Failed{};
    }
};

// Every argument of a call; what was already held is released when a later one does not fit.
template <std::size_t I, class T> struct Slot : Given<T> {
    explicit Slot(PyObject *const *given) : Given<T>(given[I], int(I) + 1) {}
};
template <class Places, class... Args> struct Slots;
template <std::size_t... I, class... Args> struct Slots<std::index_sequence<I...>, Args...> : Slot<I, Args>... {
    explicit Slots(PyObject *const *given) : Slot<I, Args>(given)... {}
    template <class R> R call(R (*kernel)(Args...)) { return kernel(static_cast<Slot<I, Args> &>(*this).value...); }
};

PyObject *result(double value) { return PyFloat_FromDouble(value); }
PyObject *result(i64 value) { return PyLong_FromLongLong(value); }

template <class R, class... Args> PyObject *called(R (*kernel)(Args...), PyObject *const *given, Py_ssize_t count) {
    if (count != Py_ssize_t(sizeof...(Args))) {
        return PyErr_Format(PyExc_TypeError, "%d arguments are wanted, not %zd", int(sizeof...(Args)), count);
    }
    try {
        Slots<std::index_sequence_for<Args...>, Args...> held(given);
        std::string error;
        bool memory = true;
        std::conditional_t<std::is_void_v<R>, int, R> made{};
        PyThreadState *state = PyEval_SaveThread();
        try {
            if constexpr (std::is_void_v<R>) {
                held.call(kernel);
            } else {
                made = held.call(kernel);
            }
        } catch (const std::bad_alloc &) {
            memory = false;
        } catch (const std::exception &failure) {
            error = failure.what();
        }
        PyEval_RestoreThread(state);
        if (!memory) return PyErr_NoMemory();
        if (!error.empty()) return PyErr_Format(PyExc_ValueError, "%s", error.c_str());
        if constexpr (std::is_void_v<R>) {
            Py_INCREF(Py_None);
            return Py_None;
        } else {
            return result(made);
        }
    } catch (const Failed &) {
        return nullptr;
    }
}

template <auto Kernel> PyObject *function(PyObject *, PyObject *const *given, Py_ssize_t count) {
    return called(active->*Kernel, given, count);
}

struct Set {
    const char *name;
    const Kernels *(*kernels)();
};
const Set SETS[] = {
    {"avx2", guise::avx2_kernels}, {"sse4.1", guise::sse41_kernels}, {"plain", guise::plain_kernels}};

PyObject *sets(PyObject *, PyObject *) {
    PyObject *names = PyList_New(0);
    for (const Set &set : SETS) {
        if (!names || !set.kernels()) continue;
        PyObject *name = PyUnicode_FromString(set.name);
        if (!name || PyList_Append(names, name) != 0) Py_CLEAR(names);
        Py_XDECREF(name);
    }
    return names;
}

PyObject *use(PyObject *, PyObject *wanted) {
    for (const Set &set : SETS) {
        if (PyUnicode_CompareWithASCIIString(wanted, set.name) == 0 && set.kernels()) {
            active = set.kernels();
            Py_INCREF(Py_None);
            return Py_None;
        }
    }
    return PyErr_Format(PyExc_ValueError, "this computer has no kernels %R", wanted);
}

#define KERNEL(name) \
    {#name, reinterpret_cast<PyCFunction>(reinterpret_cast<void *>(function<&Kernels::name>)), METH_FASTCALL, nullptr},

PyMethodDef METHODS[] = {
    {"sets", sets, METH_NOARGS, "Names of the instruction sets that the kernels can use here, the best first."},
    {"use", use, METH_O, "Take the kernels of an instruction set; ValueError if there are none."},
    GUISE_KERNELS(KERNEL)
    {nullptr, nullptr, 0, nullptr}};

PyModuleDef MODULE = {PyModuleDef_HEAD_INIT, "_kernels", "Guise's compiled kernels.", -1, METHODS,
                      nullptr,               nullptr,    nullptr,                     nullptr};

}  // namespace

PyMODINIT_FUNC PyInit__kernels() {
    for (const Set &set : SETS) {
        if (!active) active = set.kernels();
    }
    return PyModule_Create(&MODULE);
}
