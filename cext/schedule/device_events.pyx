# cython: freethreading_compatible=True
"""Events of devices during a run: zeroing, and drives that are taken out or armed again."""

from libc.stdlib cimport calloc, free

from cext.memory.event_template cimport EventTemplate

EVENTS = {                          # kind and text
    ZEROED: ("zero", "the present position of the drive is its zero"),
    ZERO_REFUSED: ("warning", "the zero was not set: it can be set after 0.1 s of zero torque and rest"),
    ZERO_NOT_SET: ("warning", "the drive has not confirmed its zero; the earlier one is in force"),
    TAKEN_OUT: ("drive", "taken out; {path}.disabled=false arms it again"),
    RETURNED: ("drive", "armed again; its commands fade in"),
    NOT_RETURNED: (
        "warning",
        "not armed again: it does not reply, it reports a fault, or the angle of its joint is out of range or "
        "ambiguous"),
    NOT_STOPPED: ("drive", "has not confirmed that it is disabled; disable is repeated. Cut its power"),
    STOPPED: ("drive", "has confirmed that it is disabled"),
}


cdef class DeviceEvents:
    """Templates of the events of devices that can be zeroed or taken out.

    devices : list of graph.schedule.DeviceSteps
    """

    def __init__(self, devices):
        self.templates, self.layout = [], NULL
        self.places = <void **>calloc(max(1, len(devices)) * DEVICE_EVENTS, sizeof(void *))
        for index, entry in enumerate(devices):
            if entry.zeroing is None and entry.disabled_slot < 0:
                continue
            for event, (kind, text) in EVENTS.items():
                fields = {"event": kind, "device": entry.name, "what": text.format(path=entry.name)}
                if kind == "drive":
                    fields["lines"] = [f"tickwork: {entry.name} is {fields['what']}"]
                template = EventTemplate(fields)
                self.templates.append(template)
                self.places[index * DEVICE_EVENTS + event] = <void *>template

    def __dealloc__(self):
        free(self.places)

    cdef uint64_t share(self, SharedLayout *layout):
        """Set the shared state for the events, or NULL. Returns the ring bytes that one tick may need."""
        self.layout = layout
        return sum(8 + (<EventTemplate>template).size() for template in self.templates)

    cdef void publish(self, int device, int event, int64_t tick) noexcept nogil:
        """Publish an event of a device."""
        cdef void *template = self.places[device * DEVICE_EVENTS + event]
        if template != NULL:
            (<EventTemplate>template).publish(self.layout, tick)
