"""Wearer of the prosthesis in simulation: the residual thigh of a walking adult, with a leg below it on the ground.

The thigh and the sound leg move as those of an average adult, whatever the prosthesis does. Shank and foot are rigid
and move by the drives of knee and ankle, their weight and the ground; the hips give way to what the ground force lacks
of the adult's.
"""

from math import copysign, cos, sin

from blocks.wearer import SegmentIMU, Walker
from blocks.wearer.body import ANKLE_HEIGHT, BALL, GRAVITY, HEEL, SHANK_LENGTH
from graph import Block, Diagram, Input, Output, Param, subsystem

STEPS = 4  # of the integration per tick
GROUND, RESTITUTION, FRICTION, GRIP, SLIDE = 25e3, 3.0, 0.8, 20e3, 150.0  # N/m, s/m, 1, N/m, N·s/m
HIPS, YIELD = 12e3, 3000.0  # N/m, N·s/m, of the sound leg and the trunk against a drop of the hips
SHANK, FOOT = (3.0, 0.14, 0.05), (1.2, 0.05, -0.04, 0.006)  # kg, m from the joint (the foot's forward, up), kg·m²
ROTOR = 0.03  # kg·m², inertia of each drive at its joint
STOP, STRAIGHT = (2000.0, 20.0), -0.03  # N·m/rad and N·m·s/rad beyond a straight knee, rad


class LowerLeg(Block):
    """Prosthetic shank and foot that hang from a moving knee: two rigid segments, with ground under heel and ball."""

    mass = Param(70.0, "kg", "mass of the wearer", above=0.0)
    height = Param(1.7, "m", "height of the wearer", above=0.0)

    thigh = Input("any", "motion of the thigh, as an output of a Walker", shape=(9,))
    shank = Input("any", "motion of the shank of the adult, whose knee is that of the prosthesis", shape=(9,))
    adult_force = Input("N", "ground force on this foot of the adult, forward and up", shape=(2,))
    knee_torque = Input("N·m", "torque of the knee, positive in flexion")
    ankle_torque = Input("N·m", "torque of the ankle, positive in dorsiflexion")
    knee_angle = Output("rad", "knee flexion")
    knee_velocity = Output("rad/s", "velocity of the knee")
    ankle_angle = Output("rad", "ankle dorsiflexion")
    ankle_velocity = Output("rad/s", "velocity of the ankle")
    ground_force = Output("N", "ground force on the foot, forward and up", shape=(2,))
    axial_force = Output("N", "force along the shank, positive in compression")
    drop = Output("m", "height of the hips above that of the adult")

    def reset(self):
        self.begun = False
        self.angles, self.rates = [0.0, 0.0], [0.0, 0.0]  # of shank and foot, front up
        self.raised, self.rising = 0.0, 0.0
        self.anchors = [0.0, 0.0]  # of heel and ball
        self.force = 0j  # of the ground

    def step(self, thigh, shank):
        if not self.begun:  # as the adult, who stands
            self.begun, self.angles = True, [float(shank[6]), 0.0]
        (s, p), (ds, dp) = self.angles, self.rates
        along = (self.force * _turn(s).conjugate()).imag
        return thigh[6] - s, thigh[7] - ds, p - s, dp - ds, (self.force.real, self.force.imag), along, self.raised

    def update(self, thigh, shank, adult_force, knee_torque, ankle_torque):
        position, velocity = complex(shank[0], shank[1]), complex(shank[2], shank[3])
        acceleration = complex(shank[4], shank[5] + GRAVITY)
        dt = self.dt / STEPS
        for _ in range(STEPS):
            knee = position + 1j * self.raised, velocity + 1j * self.rising, acceleration
            self.advance(dt, knee, thigh, knee_torque, ankle_torque)
            lacking = self.force.imag - adult_force[1] - HIPS * self.raised - YIELD * self.rising
            self.rising += lacking / self.mass * dt
            self.raised += self.rising * dt

    def advance(self, dt, knee, thigh, knee_torque, ankle_torque):
        """Integrate shank and foot over one step: M q̈ = Q, in the pitches q of both. knee : its motion, complex"""
        (at, velocity, acceleration), (s, p), (ds, dp) = knee, self.angles, self.rates
        length, (m1, c, i1), (m2, ahead, above, i2) = SHANK_LENGTH * self.height, SHANK, FOOT
        along, forward, centre = _turn(s), _turn(p), complex(ahead, above)
        ankle = at - 1j * length * along
        by_shank, by_foot = length * along, 1j * centre * forward  # of the foot's centre of mass, per rad
        first = acceleration + 1j * c * along * ds * ds
        second = acceleration + 1j * length * along * ds * ds - centre * forward * dp * dp
        bend = thigh[6] - s
        if bend < STRAIGHT:
            knee_torque += max(0.0, STOP[0] * (STRAIGHT - bend) - STOP[1] * (thigh[7] - ds))
        q_shank = -knee_torque - ankle_torque + ROTOR * thigh[8]
        q_shank -= _dot(c * along, m1 * first) + _dot(by_shank, m2 * second)
        q_foot = ankle_torque - _dot(by_foot, m2 * second)
        self.force = 0j
        for n, place in enumerate((HEEL, BALL)):
            arm = complex(place, -ANKLE_HEIGHT) * self.height * forward
            push = self.contact(n, ankle + arm, velocity + length * along * ds + 1j * arm * dp)
            self.force += push
            q_shank += _dot(by_shank, push)
            q_foot += _dot(1j * arm, push)
        m_ss = i1 + m1 * c * c + m2 * length * length + 2.0 * ROTOR
        m_sp, m_pp = m2 * _dot(by_shank, by_foot) - ROTOR, i2 + m2 * abs(centre) ** 2 + ROTOR
        size = m_ss * m_pp - m_sp * m_sp
        ds += (m_pp * q_shank - m_sp * q_foot) / size * dt
        dp += (m_ss * q_foot - m_sp * q_shank) / size * dt
        self.angles, self.rates = [s + ds * dt, p + dp * dt], [ds, dp]

    def contact(self, n, place, velocity):
        """Return the force of the ground on a point of the sole, N. n : 0 heel, 1 ball"""
        up = max(0.0, -GROUND * place.imag * (1.0 - RESTITUTION * velocity.imag)) if place.imag < 0.0 else 0.0
        if up == 0.0:
            self.anchors[n] = place.real
            return 0j
        held = GRIP * (self.anchors[n] - place.real)
        along = held - SLIDE * velocity.real
        if abs(along) > FRICTION * up:
            along = copysign(FRICTION * up, along)
            self.anchors[n] = place.real + along / GRIP
        return complex(along, up)


def _turn(angle):
    """Return the unit vector that points forward in a segment of this pitch."""
    return complex(cos(angle), sin(angle))


def _dot(a, b):
    """Return the scalar product of two vectors."""
    return a.real * b.real + a.imag * b.imag


def amputee(robot, speed="1.2", mass=70.0, height=1.7, person=0, seed=0, recording=""):
    """Return the plant: an adult who wears the robot on one side.

    speed : m/s, 1.5 s after the first step, or as in "0:0 2:1.2 20:1.2"
    mass, height : kg, m
    person : 0 for the average adult, or the number of another
    recording : path of a recorded motion, as in Walker, instead of speed and person
    """
    [side] = {block.path.partition("/")[0] for block in robot if block.path.endswith("/knee")}
    with Diagram("amputee", rate=5 * robot.rate) as plant:
        schedule = speed if ":" in str(speed) else f"0:0 0.5:0 2:{speed}"
        motion = Walker(schedule, mass=mass, height=height, person=person, seed=seed, recording=recording)()._asdict()
        thigh, shank, force = (motion[f"{side}_{name}"] for name in ("thigh_motion", "shank_motion", "ground_force"))
        with subsystem(side):
            leg = LowerLeg(mass=mass, height=height, name="lower_leg")
            drives = {joint: robot[f"{side}/{joint}"].emulator(name=joint) for joint in ("knee", "ankle")}
            leg(thigh, shank, force, *(drive.torque for drive in drives.values()))
            for joint, drive in drives.items():
                drive(position=getattr(leg, f"{joint}_angle"), velocity=getattr(leg, f"{joint}_velocity"))
            robot[f"{side}/pylon_cell"].emulator(name="pylon_cell")(force=leg.axial_force)
            sensor = SegmentIMU(along=0.2, forward=0.08, name="thigh_sensor")(thigh)._asdict()
            emulated = robot[f"{side}/thigh_imu"].emulator(name="thigh_imu")
            emulated(**{port: signal for port, signal in sensor.items() if port in emulated.inputs})
    return plant
