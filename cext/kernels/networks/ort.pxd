"""C API of ONNX Runtime: the entries that a run uses, at their fixed places in its table.

The table only grows (onnxruntime_c_api.h), so that API version 13 is part of every release from 1.13 on.
"""

from libc.stdint cimport int64_t, uint32_t

cdef enum:
    API_VERSION = 13
    FLOAT = 1                       # ONNX_TENSOR_ELEMENT_DATA_TYPE_FLOAT
    TENSOR = 1                      # ONNX_TYPE_TENSOR
    LOG_LEVEL = 4                   # ORT_LOGGING_LEVEL_FATAL: errors are returned
    ARENA_ALLOCATOR = 1             # OrtArenaAllocator
    DEFAULT_MEMORY = 0              # OrtMemTypeDefault

cdef struct ApiBase:
    const Api *(*GetApi)(uint32_t version) noexcept nogil
    const char *(*GetVersionString)() noexcept nogil

cdef struct Api:                    # functions that return void * return NULL, or a status to release
    void *gap_0[2]
    const char *(*GetErrorMessage)(const void *status) noexcept nogil
    void *(*CreateEnv)(int level, const char *name, void **env) noexcept nogil
    void *gap_4[4]
    void *(*CreateSessionFromArray)(
        const void *env, const void *model, size_t size, const void *options, void **session) noexcept nogil
    void *(*Run)(
        void *session, const void *options, const char *const *input_names, const void *const *inputs, size_t input_count,
        const char *const *output_names, size_t output_count, void **outputs) noexcept nogil
    void *(*CreateSessionOptions)(void **options) noexcept nogil
    void *gap_11[11]
    void *(*SetSessionLogSeverityLevel)(void *options, int level) noexcept nogil
    void *gap_23[1]
    void *(*SetIntraOpNumThreads)(void *options, int count) noexcept nogil
    void *(*SetInterOpNumThreads)(void *options, int count) noexcept nogil
    void *gap_26[4]
    void *(*SessionGetInputCount)(const void *session, size_t *count) noexcept nogil
    void *(*SessionGetOutputCount)(const void *session, size_t *count) noexcept nogil
    void *gap_32[1]
    void *(*SessionGetInputTypeInfo)(const void *session, size_t index, void **info) noexcept nogil
    void *(*SessionGetOutputTypeInfo)(const void *session, size_t index, void **info) noexcept nogil
    void *gap_35[1]
    void *(*SessionGetInputName)(const void *session, size_t index, void *allocator, char **name) noexcept nogil
    void *(*SessionGetOutputName)(const void *session, size_t index, void *allocator, char **name) noexcept nogil
    void *gap_38[11]
    void *(*CreateTensorWithDataAsOrtValue)(
        const void *memory, void *data, size_t bytes, const int64_t *shape, size_t rank, int type,
        void **value) noexcept nogil
    void *gap_50[5]
    void *(*CastTypeInfoToTensorInfo)(const void *info, const void **tensor) noexcept nogil
    void *(*GetOnnxTypeFromTypeInfo)(const void *info, int *type) noexcept nogil
    void *gap_57[3]
    void *(*GetTensorElementType)(const void *tensor, int *type) noexcept nogil
    void *(*GetDimensionsCount)(const void *tensor, size_t *rank) noexcept nogil
    void *(*GetDimensions)(const void *tensor, int64_t *shape, size_t rank) noexcept nogil
    void *gap_63[6]
    void *(*CreateCpuMemoryInfo)(int allocator, int type, void **memory) noexcept nogil
    void *gap_70[6]
    void *(*AllocatorFree)(void *allocator, void *data) noexcept nogil
    void *gap_77[1]
    void *(*GetAllocatorWithDefaultOptions)(void **allocator) noexcept nogil
    void *gap_79[14]
    void (*ReleaseStatus)(void *status) noexcept nogil
    void (*ReleaseMemoryInfo)(void *memory) noexcept nogil
    void (*ReleaseSession)(void *session) noexcept nogil
    void (*ReleaseValue)(void *value) noexcept nogil
    void *gap_97[1]
    void (*ReleaseTypeInfo)(void *info) noexcept nogil
    void *gap_99[1]
    void (*ReleaseSessionOptions)(void *options) noexcept nogil
    void *gap_101[10]
    void *(*SessionGetModelMetadata)(const void *session, void **metadata) noexcept nogil
    void *gap_112[4]
    void *(*ModelMetadataLookupCustomMetadataMap)(
        const void *metadata, void *allocator, const char *key, char **value) noexcept nogil
    void *gap_117[1]
    void (*ReleaseModelMetadata)(void *metadata) noexcept nogil
    void *gap_119[6]
    void *(*GetAvailableProviders)(char ***names, int *count) noexcept nogil
    void *(*ReleaseAvailableProviders)(char **names, int count) noexcept nogil
    void *gap_127[3]
    void *(*AddSessionConfigEntry)(void *options, const char *key, const char *value) noexcept nogil
    void *gap_131[39]
    void *(*AppendTensorRT)(void *options, const void *provider) noexcept nogil
    void *(*CreateTensorRTProviderOptions)(void **provider) noexcept nogil
    void *gap_172[2]
    void (*ReleaseTensorRTProviderOptions)(void *provider) noexcept nogil
    void *gap_175[29]
    void *(*AppendCUDA)(void *options, const void *provider) noexcept nogil
    void *(*CreateCUDAProviderOptions)(void **provider) noexcept nogil
    void *gap_206[2]
    void (*ReleaseCUDAProviderOptions)(void *provider) noexcept nogil
