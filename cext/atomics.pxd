"""Atomic words shared by threads and processes.

    load, store             acquire, release: a store is not visible before what precedes it
    load_..., store_...
      ..._in_order          sequentially consistent: where each of two threads stores to one word and then loads what the
                            other has stored, at least one of them finds the other's value. Acquire and release do not give
                            that: a processor may load first, as x86-64 and Armv8 (`stlr; ldapr`) do
    load_..., store_...
      ..._relaxed           atomic alone, for data that other operations order, or that needs no order
    swap, count_up          read-modify-write
"""

from libc.stdint cimport int32_t, int64_t, uint64_t

cdef extern from *:
    """
    #include <stdint.h>
    #define tw_load(pointer) __atomic_load_n((pointer), __ATOMIC_ACQUIRE)
    #define tw_store(pointer, value) __atomic_store_n((pointer), (value), __ATOMIC_RELEASE)
    #define tw_load_in_order(pointer) __atomic_load_n((pointer), __ATOMIC_SEQ_CST)
    #define tw_store_in_order(pointer, value) __atomic_store_n((pointer), (value), __ATOMIC_SEQ_CST)
    #define tw_load_relaxed(pointer) __atomic_load_n((pointer), __ATOMIC_RELAXED)
    #define tw_store_relaxed(pointer, value) __atomic_store_n((pointer), (value), __ATOMIC_RELAXED)
    #define tw_fence_release() __atomic_thread_fence(__ATOMIC_RELEASE)
    #define tw_fence_acquire() __atomic_thread_fence(__ATOMIC_ACQUIRE)
    #define tw_count(pointer) __atomic_add_fetch((pointer), 1, __ATOMIC_ACQ_REL)
    static inline int tw_swap(uint64_t *pointer, uint64_t old, uint64_t value) {
        return __atomic_compare_exchange_n(pointer, &old, value, 0, __ATOMIC_ACQ_REL, __ATOMIC_ACQUIRE);
    }
    static inline int tw_swap_32(int32_t *pointer, int32_t old, int32_t value) {
        return __atomic_compare_exchange_n(pointer, &old, value, 0, __ATOMIC_ACQ_REL, __ATOMIC_ACQUIRE);
    }
    """
    uint64_t load_u64 "tw_load"(const uint64_t *pointer) noexcept nogil
    int64_t load_i64 "tw_load"(const int64_t *pointer) noexcept nogil
    int32_t load_i32 "tw_load"(const int32_t *pointer) noexcept nogil
    void store_u64 "tw_store"(uint64_t *pointer, uint64_t value) noexcept nogil
    void store_i64 "tw_store"(int64_t *pointer, int64_t value) noexcept nogil
    void store_i32 "tw_store"(int32_t *pointer, int32_t value) noexcept nogil
    uint64_t load_u64_in_order "tw_load_in_order"(const uint64_t *pointer) noexcept nogil
    int32_t load_i32_in_order "tw_load_in_order"(const int32_t *pointer) noexcept nogil
    void store_u64_in_order "tw_store_in_order"(uint64_t *pointer, uint64_t value) noexcept nogil
    void store_i32_in_order "tw_store_in_order"(int32_t *pointer, int32_t value) noexcept nogil
    uint64_t load_u64_relaxed "tw_load_relaxed"(const uint64_t *pointer) noexcept nogil
    int32_t load_i32_relaxed "tw_load_relaxed"(const int32_t *pointer) noexcept nogil
    void store_u64_relaxed "tw_store_relaxed"(uint64_t *pointer, uint64_t value) noexcept nogil
    void store_i32_relaxed "tw_store_relaxed"(int32_t *pointer, int32_t value) noexcept nogil
    # later stores become visible later
    void fence_release "tw_fence_release"() noexcept nogil
    void fence_acquire "tw_fence_acquire"() noexcept nogil                                  # later loads are not older
    uint64_t count_up "tw_count"(uint64_t *pointer) noexcept nogil                          # returns the new count
    # False: the value was not `old`
    bint swap "tw_swap"(uint64_t *pointer, uint64_t old, uint64_t value) noexcept nogil
    bint swap_i32 "tw_swap_32"(int32_t *pointer, int32_t old, int32_t value) noexcept nogil
