"""A controller that asks a monitor: PID loops that stop damping by a gyro which is under suspicion."""

from pid import Pid

import gtmbench as gb


class Asking(Pid):
    def __init__(self, monitor):
        self.monitor = monitor

    def start(self, trim):
        super().start(trim)
        self.stream, self.doubted = self.monitor.stream(), set()

    def command(self, now, time_s):
        sample = gb.Record([now], channels=now._fields, sample_period_s=0.01, start_s=time_s)
        for alarm in self.stream.push(sample):
            self.doubted |= {"p", "q", "r"} & set(alarm.candidates)
        return super().command(now._replace(**dict.fromkeys(self.doubted, 0.0)), time_s)
