"""Flight software of the platform: Sun pointing, desaturation and attitude control."""

from __future__ import annotations

from typing import Any

import numpy as np

from ...utils.functional import default_args
from .. import dyn
from .base import FSWModel, Task, call_of


class BasicFSWModel(FSWModel):
    """Flight software that charges, desaturates wheels and controls the attitude by MRP feedback."""

    @classmethod
    def _requires_dyn(cls) -> list[type]:
        return [dyn.BasicDynamicsModel]

    action_charge = call_of("action_charge")
    action_desat = call_of("action_desat")

    class RWDesatTask(Task):
        """Desaturation of the wheels by thrusters."""

        name = "rwDesatTask"

        @default_args(controlAxes_B=[1, 0, 0, 0, 1, 0, 0, 0, 1], thrForceSign=+1)
        def setup_thruster_mapping(self, controlAxes_B: Any, thrForceSign: int) -> None:
            """Names the axes of control and the sign of the thrusters' forces."""

        @default_args(hs_min=0.0, maxCounterValue=4, thrMinFireTime=0.02, desatAttitude="sun")
        def setup_momentum_dumping(self, hs_min: float, maxCounterValue: int, thrMinFireTime: float, desatAttitude: str) -> None:
            """Names the least momentum (N·m·s), the periods between pulses, their least duration
            (s), and the attitude while desaturating: "sun", "nadir" or None.
            """

    class MRPControlTask(Task):
        """Control of the attitude by MRP feedback."""

        name = "mrpControlTask"

        @default_args(K=7.0, Ki=-1, P=35.0)
        def setup_mrp_feedback_rwa(self, K: float, Ki: float, P: float) -> None:
            """Names the gains of attitude, integral and rate."""


class SteeringFSWModel(BasicFSWModel):
    """Flight software that controls the attitude by MRP steering."""

    class MRPControlTask(Task):
        """Control of the attitude by MRP steering and a rate servo."""

        name = "mrpControlTask"

        @default_args(K1=0.25, K3=3.0, omega_max=np.radians(3), servo_Ki=5.0, servo_P=150)
        def setup_mrp_steering_rwa(self, K1: float, K3: float, omega_max: float, servo_Ki: float, servo_P: float) -> None:
            """Names the gains of steering and servo, and the largest body rate in rad/s."""
