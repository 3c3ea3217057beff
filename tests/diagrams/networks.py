"""The trained networks, run by ONNX Runtime over whole series and sample by sample."""

import numpy as np
import onnx
import onnxruntime

from diagrams.networks import export
from tests.checkout import ROOT

FOLDER = ROOT / "diagrams" / "networks"
NAMES = ("gait_phase", "hip_torque", "knee_torque", "ankle_torque")


class Network:
    """A trained network: metadata, receptive field in samples, and sessions of ONNX Runtime by length of the input."""

    def __init__(self, name):
        self.path = FOLDER / f"{name}.onnx"
        self.layers, self.dilations, self.metadata = export.contents(onnx.load(self.path))
        self.field = self.metadata["receptive_field"]
        self.channels, self.outputs = self.metadata["channels"], self.metadata["outputs"]

    def session(self, samples):
        """Return a session for `samples` at a time; 1 is the file itself."""
        options = onnxruntime.SessionOptions()
        options.intra_op_num_threads, options.log_severity_level = 1, 3
        model = export.model(self.layers, self.dilations, {}, samples)
        return onnxruntime.InferenceSession(
            self.path.read_bytes() if samples == 1 else model.SerializeToString(), options
        )

    def operand(self, signals):
        """Return the normalised channels as (1, channels, samples)."""
        rows = [(signals[each["name"]] - each["mean"]) / each["std"] for each in self.channels]
        return np.array([rows], np.float32)

    def of_series(self, signals):
        """Return {output: values} from sample `field` on, of signals by name."""
        x = self.operand(signals)
        y = self.session(x.shape[2]).run(None, {"x": x})[0][0].astype(float)
        return {
            each["name"]: np.clip(row * each["std"] + each["mean"], *each["range"])
            for each, row in zip(self.outputs, y)
        }

    def of_windows(self, signals):
        """Return the network's own outputs (samples - field + 1, outputs), each of a window of `field` samples."""
        x, session = self.operand(signals), self.session(self.field)
        ends = range(self.field, x.shape[2] + 1)
        return np.array([session.run(None, {"x": x[:, :, end - self.field : end]})[0][0, :, 0] for end in ends])

    def of_samples(self, signals):
        """Return the same of one sample after the other, (samples, outputs)."""
        x, session = self.operand(signals), self.session(1)
        states = {each.name: np.zeros(each.shape, np.float32) for each in session.get_inputs() if each.name != "x"}
        names = [each.name for each in session.get_outputs()]
        rows = []
        for k in range(x.shape[2]):
            results = dict(zip(names, session.run(None, {"x": x[:, :, k : k + 1], **states})))
            states = {name: results[f"{name}_next"] for name in states}
            rows.append(results["y"][0, :, 0])
        return np.array(rows)


def phase_error(estimates, turns):
    """Return the error of an estimated gait phase in strides, from -0.5 to 0.5. turns : true phase in rad"""
    estimate = estimates["phase_cos"] + 1j * estimates["phase_sin"]
    return np.angle(estimate * np.exp(-1j * turns)) / (2.0 * np.pi)
