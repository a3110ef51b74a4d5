"""A controller of one's own: PID loops that hold altitude, heading and speed on what the sensors read.

gtmbench fly --closed-loop --controller pid.py:Pid --excitation turbulence --noise t2 --out pid.csv
"""


class Pid:
    def start(self, trim):  # before every flight: forget the last one
        self.trim, self.climb_deg = trim, 0.0

    def command(self, now, time_s):  # now: deg, deg/s, kt, ft; returns deg and percent
        low_ft = self.trim.altitude_ft - now.altitude
        self.climb_deg += 0.0001 * low_ft
        theta = self.trim.pitch_deg + max(-8.0, min(8.0, 0.05 * low_ft + self.climb_deg))
        phi = max(-20.0, min(20.0, 0.8 * (self.trim.yaw_deg - now.psi)))
        level = self.trim.commands
        elevator = level["elevator"] + 0.8 * (now.theta - theta) + 0.2 * now.q
        aileron = level["aileron"] + 0.4 * (now.phi - phi) + 0.1 * now.p
        return elevator, aileron, level["rudder"] + 0.2 * now.r, level["throttle"] + 2.0 * (self.trim.tas_kt - now.tas)
