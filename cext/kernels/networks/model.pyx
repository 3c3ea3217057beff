# cython: freethreading_compatible=True
"""A model in ONNX form, loaded by ONNX Runtime: its tensors, and inferences without Python.

ONNX Runtime is the library in its wheel, which exports OrtGetApiBase. A session has one thread of its own: the caller.
"""

import ctypes
import importlib.util
from array import array
from pathlib import Path

from libc.stdint cimport int64_t, uintptr_t
from libc.string cimport memcpy, memset, strncpy

from cext.clock.deadline_clock cimport monotonic
from cext.clock.histogram cimport add, summary
from cext.kernels.networks.ort cimport (
    API_VERSION, ARENA_ALLOCATOR, DEFAULT_MEMORY, FLOAT, LOG_LEVEL, TENSOR, Api, ApiBase,
)

PROVIDERS = {"cpu": "CPUExecutionProvider", "cuda": "CUDAExecutionProvider", "tensorrt": "TensorrtExecutionProvider"}
METADATA_KEY = "tickwork"
WEIGHTS_FOLDER = b"session.model_external_initializers_file_folder_path"
EXTRA = "pip install 'tickwork[networks]'"
LIBRARIES = "libonnxruntime.so*", "onnxruntime_pybind11_state*.so"      # in folder capi of the wheel, by preference

cdef const Api *loaded = NULL           # one library and one environment per process
cdef void *environment = NULL
cdef str loaded_version = ""


def runtime_version() -> str:
    """Return the version of ONNX Runtime; "" before a model has been loaded."""
    return loaded_version or ""


cdef const Api *api_of_library() except NULL:
    """Load ONNX Runtime once. Raises ValueError if it is missing, damaged or too old."""
    global loaded, environment, loaded_version
    cdef const ApiBase *base
    cdef const Api *api
    if loaded != NULL:
        return loaded
    path = library()
    try:
        entry = ctypes.CDLL(str(path)).OrtGetApiBase
        entry.restype = ctypes.c_void_p
        base = <const ApiBase *><uintptr_t>entry()
    except (OSError, AttributeError) as error:
        raise ValueError(f"{path} is not a usable library of ONNX Runtime ({error}): {EXTRA}") from None
    loaded_version = base.GetVersionString().decode()
    api = base.GetApi(API_VERSION)
    if api == NULL:
        raise ValueError(f"ONNX Runtime {loaded_version} is too old: {EXTRA}")
    check(api, api.CreateEnv(LOG_LEVEL, b"tickwork", &environment))
    loaded = api
    return loaded


def library() -> Path:
    """Return the path of ONNX Runtime's library in its installed wheel. Raises ValueError if there is none."""
    spec = importlib.util.find_spec("onnxruntime")
    if spec is None or not spec.submodule_search_locations:
        raise ValueError(f"ONNX Runtime is not installed: {EXTRA}")
    folder = Path(spec.submodule_search_locations[0]) / "capi"
    found = next((path for pattern in LIBRARIES for path in sorted(folder.glob(pattern))), None)
    if found is None:
        raise ValueError(f"{folder} contains no library of ONNX Runtime: {EXTRA}")
    return found


cdef int check(const Api *api, void *status) except -1:
    """Raise ValueError with the text of a status, and release it. NULL is success."""
    if status == NULL:
        return 0
    text = api.GetErrorMessage(status).decode(errors="replace")
    api.ReleaseStatus(status)
    raise ValueError(text)


cdef int infer(Inference *model, float *inputs, float *outputs) noexcept nogil:
    """Run a model: `inputs` and `outputs` have its tensors one after the other. Returns 0, or -1 with `model.error`.

    The states among the outputs are then copied to the inputs, for the next inference.
    """
    cdef void *values[2 * TENSOR_LIMIT]
    cdef const char *names[2 * TENSOR_LIMIT]
    cdef const Api *api = model.api
    cdef int count = model.input_count + model.output_count
    cdef int64_t began = monotonic()
    cdef void *status = NULL
    cdef Tensor *tensor
    cdef float *buffer
    cdef int index
    memset(values, 0, count * sizeof(void *))
    for index in range(count):
        if index < model.input_count:
            tensor, buffer = &model.inputs[index], inputs
        else:
            tensor, buffer = &model.outputs[index - model.input_count], outputs
        names[index] = tensor.name
        status = api.CreateTensorWithDataAsOrtValue(
            model.memory, buffer + tensor.place, tensor.size * sizeof(float), tensor.shape, tensor.rank, FLOAT,
            &values[index])
        if status != NULL:
            break
    if status == NULL:
        status = api.Run(
            model.session, NULL, names, <const void *const *>values, model.input_count, names + model.input_count,
            model.output_count, values + model.input_count)
    for index in range(count):
        api.ReleaseValue(values[index])
    if status != NULL:
        if model.error[0] == 0:                 # written once: it may be read while later inferences fail
            strncpy(model.error, api.GetErrorMessage(status), ERROR_BYTES - 1)
        api.ReleaseStatus(status)
        return -1
    memcpy(inputs + model.signal_size, outputs + model.result_size, model.state_size * sizeof(float))
    add(&model.times, monotonic() - began, 0)
    return 0


cdef class Model:
    """A loaded model.

    content : bytes of the ONNX file
    provider : one of PROVIDERS
    folder : of further files with its weights; "" for none

    inputs, outputs : {name: shape} of its tensors; a dimension that varies is -1
    metadata : value of METADATA_KEY in the file's metadata, or ""

    Raises ValueError for a damaged file, tensors of other numbers than float32, and a provider that is not installed.
    """

    def __init__(self, bytes content, str provider="cpu", str folder=""):
        cdef const Api *api = api_of_library()
        cdef void *options = NULL
        self.version = loaded_version
        self.content = content
        self.names = []
        self.inference.api = api
        check(api, api.CreateCpuMemoryInfo(ARENA_ALLOCATOR, DEFAULT_MEMORY, &self.inference.memory))
        check(api, api.CreateSessionOptions(&options))
        try:
            check(api, api.SetIntraOpNumThreads(options, 1))
            check(api, api.SetInterOpNumThreads(options, 1))
            check(api, api.SetSessionLogSeverityLevel(options, LOG_LEVEL))
            check(api, api.AddSessionConfigEntry(options, b"session.intra_op.allow_spinning", b"0"))
            check(api, api.AddSessionConfigEntry(options, b"session.inter_op.allow_spinning", b"0"))
            if folder:
                check(api, api.AddSessionConfigEntry(options, WEIGHTS_FOLDER, folder.encode()))
            append_provider(api, options, provider)
            check(api, api.CreateSessionFromArray(
                environment, <const char *>content, len(content), options, &self.inference.session))
        finally:
            api.ReleaseSessionOptions(options)
        self.inputs = self.describe(api, self.inference.session, True)
        self.outputs = self.describe(api, self.inference.session, False)
        self.metadata = self.look_up(api, METADATA_KEY.encode())

    def __dealloc__(self):
        if self.inference.session != NULL:
            self.inference.api.ReleaseSession(self.inference.session)
        if self.inference.memory != NULL:
            self.inference.api.ReleaseMemoryInfo(self.inference.memory)

    cdef describe(self, const Api *api, void *session, bint of_inputs):
        """Return {name: shape} of the inputs or outputs."""
        cdef void *allocator = NULL
        cdef void *info = NULL
        cdef const void *tensor = NULL
        cdef char *name = NULL
        cdef size_t count = 0
        cdef size_t rank = 0
        cdef int type = 0
        cdef int64_t shape[RANK_LIMIT]
        found = {}
        check(api, api.GetAllocatorWithDefaultOptions(&allocator))
        check(api, (api.SessionGetInputCount if of_inputs else api.SessionGetOutputCount)(session, &count))
        for index in range(count):
            check(api, (api.SessionGetInputName if of_inputs else api.SessionGetOutputName)(
                session, index, allocator, &name))
            text = name.decode()
            check(api, api.AllocatorFree(allocator, name))
            check(api, (api.SessionGetInputTypeInfo if of_inputs else api.SessionGetOutputTypeInfo)(
                session, index, &info))
            try:
                check(api, api.GetOnnxTypeFromTypeInfo(info, &type))
                if type == TENSOR:
                    check(api, api.CastTypeInfoToTensorInfo(info, &tensor))
                    check(api, api.GetTensorElementType(tensor, &type))
                    check(api, api.GetDimensionsCount(tensor, &rank))
                else:
                    type = -1
                if type != FLOAT or rank > RANK_LIMIT:
                    raise ValueError(
                        f"{'input' if of_inputs else 'output'} {text!r} is not a tensor of float32 with at most "
                        f"{RANK_LIMIT} dimensions: export the model with float32 inputs and outputs")
                check(api, api.GetDimensions(tensor, shape, rank))
            finally:
                api.ReleaseTypeInfo(info)
            found[text] = tuple(shape[axis] for axis in range(rank))
        return found

    cdef str look_up(self, const Api *api, const char *key):
        """Return a value of the file's metadata, or ""."""
        cdef void *metadata = NULL
        cdef void *allocator = NULL
        cdef char *value = NULL
        check(api, api.GetAllocatorWithDefaultOptions(&allocator))
        check(api, api.SessionGetModelMetadata(self.inference.session, &metadata))
        try:
            check(api, api.ModelMetadataLookupCustomMetadataMap(metadata, allocator, key, &value))
        finally:
            api.ReleaseModelMetadata(metadata)
        if value == NULL:
            return ""
        text = value.decode(errors="replace")
        check(api, api.AllocatorFree(allocator, value))
        return text

    def arrange(self, list inputs, list outputs, int results) -> None:
        """Set the tensors of an inference.

        inputs : (name, shape) of the signal, then of the states
        outputs : (name, shape) of the results, then of the next states
        results : number of the results among them
        """
        if max(len(inputs), len(outputs)) > TENSOR_LIMIT:
            raise ValueError(f"the model has more than {TENSOR_LIMIT} inputs or outputs")
        cdef Inference *model = &self.inference
        model.input_count, model.output_count = len(inputs), len(outputs)
        model.signal_size = self.place(inputs, model.inputs, 1)
        model.result_size = self.place(outputs, model.outputs, results)
        model.state_size = end_of(model.inputs, model.input_count) - model.signal_size

    cdef size_t place(self, list tensors, Tensor *into, int first):
        """Place tensors in a buffer. Returns the number of floats of the first ones."""
        cdef size_t place = 0
        cdef size_t size_of_first = 0
        cdef Tensor *tensor
        for index, (name, shape) in enumerate(tensors):
            encoded = name.encode()
            self.names.append(encoded)
            tensor = &into[index]
            tensor.name = <const char *>(<bytes>encoded)
            tensor.rank, tensor.size, tensor.place = len(shape), 1, place
            for axis, length in enumerate(shape):
                tensor.shape[axis] = length
                tensor.size *= length
            place += tensor.size
            if index < first:
                size_of_first = place
        return size_of_first

    @property
    def address(self) -> float:
        """Address of the Inference as a number, which is exact: addresses have 53 bits at most."""
        return float(<uintptr_t>&self.inference)

    @property
    def sizes(self) -> tuple[int, int]:
        """Number of floats of all inputs, and of all outputs."""
        return (end_of(self.inference.inputs, self.inference.input_count),
                end_of(self.inference.outputs, self.inference.output_count))

    @property
    def times(self) -> dict[str, float]:
        """Percentiles of the durations of inferences since the last start of the block, in s."""
        return summary(&self.inference.times)

    @property
    def error(self) -> str:
        """Text of the last inference that failed, or ""."""
        return self.inference.error.decode(errors="replace")

    def warm_up(self) -> None:
        """Run one inference of zeros, so that the first one of a run does not allocate. Raises ValueError if it fails."""
        try:
            self.run(*(array("f", bytes(4 * size)) for size in self.sizes))
        except ValueError as error:
            raise ValueError(f"an inference with zeros fails: {error}") from None
        memset(&self.inference.times, 0, sizeof(Histogram))

    def run(self, float[::1] inputs, float[::1] outputs) -> None:
        """Run one inference on buffers of `sizes`. Raises ValueError if it fails."""
        cdef int failed
        with nogil:
            failed = infer(&self.inference, &inputs[0], &outputs[0])
        if failed:
            raise ValueError(self.error)


cdef size_t end_of(const Tensor *tensors, int count) noexcept nogil:
    return tensors[count - 1].place + tensors[count - 1].size if count else 0


cdef int append_provider(const Api *api, void *options, str provider) except -1:
    """Request an execution provider. Raises ValueError if this library does not include it."""
    cdef char **names = NULL
    cdef int count = 0
    cdef void *own = NULL
    check(api, api.GetAvailableProviders(&names, &count))
    available = [names[index].decode() for index in range(count)]
    check(api, api.ReleaseAvailableProviders(names, count))
    if PROVIDERS[provider] not in available:
        raise ValueError(
            f"provider {provider!r} is not part of the installed ONNX Runtime {loaded_version}, which has "
            f"{', '.join(available)}: install onnxruntime-gpu instead of onnxruntime, or use provider=\"cpu\"")
    if provider == "cuda":
        check(api, api.CreateCUDAProviderOptions(&own))
        try:
            check(api, api.AppendCUDA(options, own))
        finally:
            api.ReleaseCUDAProviderOptions(own)
    elif provider == "tensorrt":
        check(api, api.CreateTensorRTProviderOptions(&own))
        try:
            check(api, api.AppendTensorRT(options, own))
        finally:
            api.ReleaseTensorRTProviderOptions(own)
    return 0
