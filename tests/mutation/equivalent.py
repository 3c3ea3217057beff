"""Mutants that behave as the original does, by their names, with the reason. One that is not there and survives is a
hole in the tests.
"""

EQUIVALENT = {
    "cext/kernels/limiters.pyx remember: add(sums + RUNNING, square) -> add(sums - RUNNING, square)": "RUNNING is 0",
    "cext/kernels/limiters.pyx remember: add(sums + RUNNING, -arena[at.squares + place]) -> "
    "add(sums - RUNNING, -arena[at.squares + place])": "RUNNING is 0",
    "cext/kernels/limiters.pyx rms_torque_kernel: most = sqrt(budget / arena[at.ticks]) if budget > 0.0 else 0.0 "
    "-> "
    "most = sqrt(budget / arena[at.ticks]) if budget >= 0.0 else 0.0": "the root of 0 is 0",
    "cext/kernels/limiters.pyx soft_stop_kernel: if velocity > 0.0: -> if velocity >= 0.0:": "it "
    "takes nothing away then",
    "cext/kernels/limiters.pyx soft_stop_kernel: if velocity < 0.0: -> if velocity <= 0.0:": "it "
    "takes nothing away then",
    "cext/kernels/limiters.pyx power_kernel: torque = power / fabs(velocity) if torque > 0.0 else -power / "
    "fabs(velocity) -> "
    "torque = power / fabs(velocity) if torque >= 0.0 else -power / fabs(velocity)": "a torque of 0 has no power to "
    "limit",
    "cext/kernels/limiters.pyx derating_kernel: "
    "share = 1.0 if temperature <= full else 0.0 if temperature >= none else (none - temperature) / (none - full) -> "
    "share = 1.0 if temperature < full else 0.0 if temperature >= none else (none - temperature) / (none - full)": "the"
    " line begins with the share of 1",
    "cext/kernels/limiters.pyx derating_kernel: "
    "share = 1.0 if temperature <= full else 0.0 if temperature >= none else (none - temperature) / (none - full) -> "
    "share = 1.0 if temperature <= full else 0.0 if temperature > none else (none - temperature) / (none - full)": "the"
    " share is 0 then, either way",
    "cext/kernels/limiters.pyx soft_start_kernel: share = 1.0 if elapsed[0] >= arena[at.duration] else elapsed[0] / "
    "arena[at.duration] -> "
    "share = 1.0 if elapsed[0] > arena[at.duration] else elapsed[0] / arena[at.duration]": "the share "
    "is 1 then, either way",
    "cext/kernels/limiters.pyx soft_start_kernel: elapsed[0] = -1.0 -> elapsed[0] = -2.0": "anything below 0 says "
    "that it has not begun",
    "cext/kernels/limiters.pyx rms_torque_kernel: "
    "budget = length * limit * limit * (1.0 - 1e-12) - (sums[RUNNING] + sums[RUNNING_REST] - arena[at.squares + "
    "place]) -> "
    "budget = length * limit * limit * (1.0 - 1e-13) - (sums[RUNNING] + sums[RUNNING_REST] - arena[at.squares + "
    "place])": "the margin for rounding is a thousand times what is lost",
    "cext/kernels/limits.pxd clip: x = x if x < high else high -> x = x if x <= high else high": "they "
    "are the same number",
    "cext/kernels/limits.pxd clip: x = x if x > low else low   # without branches, which mispredict with the data; NaN "
    "becomes a bound here -> "
    "x = x if x >= low else low   # without branches, which mispredict with the data; NaN becomes a bound here": ""
    "they are the same number",
    "cext/schedule/publisher.pyx attend_fenced: return UNGUARDED if self.guard > 0 and "
    "self.guardian_is_gone(now) else OK -> "
    "return UNGUARDED if self.guard > 1 and self.guardian_is_gone(now) else OK": "by a nanosecond",
    "cext/schedule/arming.pyx halt: cdef int64_t since = 0 if self.tick >= 0 and not self.halted else damping "
    "    # ns since "
    "the begin of the stop -> "
    "cdef int64_t since = 1 if self.tick >= 0 and not self.halted else damping "
    "    # ns since the begin of the stop": "by a nanosecond",
    "cext/schedule/devices.pyx receive: if device.age >= 0: -> if device.age > 0:": "the arena begins with "
    "the clock: nothing "
    "of a block stands at 0",
    "cext/schedule/devices.pyx receive: if device.age >= 0: -> if device.age >= 1:": "the arena begins with the clock: "
    "nothing of a block stands at 0",
    "cext/schedule/devices.pyx receive: break -> pass": "what is empty gives nothing more",
    "cext/schedule/devices.pyx command: if self.laps != NULL and self.laps.each == NULL and self.table.count > 0: -> "
    "if self.laps != NULL and self.laps.each == NULL and self.table.count >= 0:": "encoding nothing takes no time",
    "cext/schedule/devices.pyx watch: if device.fault >= 0 and arena[device.fault] != 0.0: -> "
    "if device.fault >= 1 and arena[device.fault] != 0.0:": "the arena begins with the clock: nothing of a "
    "block stands at 0",
    "cext/schedule/devices.pyx watch: if device.fault >= 0 and arena[device.fault] != 0.0: -> "
    "if device.fault > 0 and arena[device.fault] != 0.0:": "the arena begins with the clock: nothing of a block "
    "stands at 0",
    "runtime/robot/guardian/stop.py __init__: self.limit = STOP_LIMIT + max((damped.end - now for damped in "
    "self.damped.values()), default=0) -> "
    "self.limit = STOP_LIMIT + max((damped.end - now for damped in self.damped.values()), default=1)": "1 ns more",
    "cext/kernels/limits.pxd toward: return previous + (most if change > 0.0 else -most) - zero "
    "-> return previous + (most if change > 0.0 else -most) + zero": "zero is 0 or NaN",
    "cext/kernels/devices/drive_law.pxd keep_inside: if fabs(torque) > limit: "
    "-> if fabs(torque) >= limit:": "the limit is the same then",
    "cext/schedule/buses.pyx send: store_i32_in_order(&self.layout.sending, 1) "
    "-> store_i32_in_order(&self.layout.sending, 2)": "any value but 0 is true",
    "cext/schedule/safe_stop.pyx send: if disabling and since < self.longest_damping and "
    "holds_relay(self.table, self.buses, device, now): -> "
    "if disabling and since <= self.longest_damping and "
    "holds_relay(self.table, self.buses, device, now):": "by a nanosecond",
    "cext/safety/stop_confirmation.pyx judge_answers: elif now - self.listened >= STOP_LISTEN_LIMIT and "
    "now + slack >= self.until: -> elif now - self.listened > STOP_LISTEN_LIMIT and now + slack >= self.until:": "by a "
    "nanosecond",
    "cext/safety/stop_confirmation.pyx judge_answers: if round + slack < self.gap <= STOP_LISTEN_LIMIT:      # after a "
    "longer one, a bus has returned -> if round + slack < self.gap < STOP_LISTEN_LIMIT:      # after a longer one, a "
    "bus has returned": "by a nanosecond",
    "cext/safety/stop_confirmation.pyx judge_answers: elif self.last >= 0 and now - self.last >= round + round // 2: "
    "-> elif self.last >= 0 and now - self.last > round + round // 2:": "by a nanosecond",
    "cext/safety/stop_confirmation.pyx judge_answers: self.phase, self.window = SENDING, 0 -> "
    "self.phase, self.window = SENDING, 1": "it ends before the next round",
    "cext/safety/stop_confirmation.pyx note: self.phase, self.window = SENDING, 0 -> "
    "self.phase, self.window = SENDING, 1": "it ends before the next round",
    "cext/safety/stop_confirmation.pyx note_rest: lag = max(frame.time - self.asked, 0) -> "
    "lag = max(frame.time - self.asked, 1)": "by a nanosecond",
    "cext/safety/stop_confirmation.pyx judge_answers: if self.last < 0 and now + slack >= self.until: -> "
    "if self.last <= 0 and now + slack >= self.until:": "no reply arrives at the first nanosecond",
    "cext/safety/stop_confirmation.pyx judge_answers: if self.last < 0 and now + slack >= self.until: -> "
    "if self.last < 1 and now + slack >= self.until:": "no reply arrives at the first nanosecond",
    "cext/safety/stop_confirmation.pyx begin: self.began, self.transit, self.asked, self.window = now, transit, -1, 0 "
    "-> self.began, self.transit, self.asked, self.window = now, transit, -2, 0": "any negative number is none",
    "cext/safety/stop_confirmation.pyx judge_answers: self.phase, self.last, self.listened = LISTENING, -1, now -> "
    "self.phase, self.last, self.listened = LISTENING, -2, now": "any negative number is none",
    "cext/safety/stop_confirmation.pyx judge_answers: elif self.phase == SENDING or now + slack >= self.until: -> "
    "elif self.phase == SENDING or now + slack > self.until:": "by a nanosecond",
    "cext/safety/stop_confirmation.pyx judge_answers: if round + slack < self.gap <= STOP_LISTEN_LIMIT:      # after a "
    "longer one, a bus has returned -> if round + slack <= self.gap <= STOP_LISTEN_LIMIT:      # after a longer one, a "
    "bus has returned": "by a nanosecond",
    "cext/safety/stop_confirmation.pyx sent: self.seen, self.source, self.gap = 0, -1, 0 "
    "-> self.seen, self.source, self.gap = 0, -2, 0": "any negative number is none",
    "cext/safety/stop_confirmation.pyx sent: self.seen, self.source, self.gap = 0, -1, 0 "
    "-> self.seen, self.source, self.gap = 0, -1, 1": "by a nanosecond",
    "cext/safety/stop_confirmation.pyx judge_answers: elif self.last >= 0 and now - self.last >= round + round // 2: "
    "-> elif self.last >= 1 and now - self.last >= round + round // 2:": "no reply arrives at the first nanosecond",
    "cext/safety/stop_confirmation.pyx judge_answers: elif now - self.listened >= STOP_LISTEN_LIMIT and "
    "now + slack >= self.until: -> elif now - self.listened >= STOP_LISTEN_LIMIT and now + slack > self.until:": "by a "
    "nanosecond",
    "cext/safety/stop_confirmation.pyx sent: if self.window > 0 and not self.confirmed:                 # then a run "
    "that waits sends in every round -> if self.window > 1 and not self.confirmed:                 # then a run that "
    "waits sends in every round": "by a nanosecond",
    "cext/safety/stop_confirmation.pyx judge_answers: elif self.last >= 0 and now - self.last >= round + round // 2: "
    "-> elif self.last > 0 and now - self.last >= round + round // 2:": "no reply arrives at the first nanosecond",
    "cext/safety/stop_confirmation.pyx begin: self.arrived, self.gap = now, 0 -> self.arrived, self.gap = now, 1": "by "
    "a nanosecond",
    "cext/schedule/foreign_commands.pxd commanded_device: return -1 -> return -2": "a negative number is no device",
}
