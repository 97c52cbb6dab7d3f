"""Flight software of the payload: imaging, scanning and downlink."""

from __future__ import annotations

from typing import Any

import numpy as np

from ...utils.elements import Vector
from ...utils.functional import default_args
from .. import dyn
from ..parameters import Parameters
from .base import Task, call_of
from .basic import BasicFSWModel, SteeringFSWModel


class ImagingFSWModel(BasicFSWModel):
    """Flight software that points the instrument at targets and triggers it."""

    @classmethod
    def _requires_dyn(cls) -> list[type]:
        return [*super()._requires_dyn(), dyn.ImagingDynModel]

    def __init__(self, *args: Any, **kwargs: Any) -> None:
        super().__init__(*args, **kwargs)
        axis = self.satellite.sat_args["inst_pHat_B"]
        self.locPoint = Parameters(pHat_B=axis)

    @property
    def c_hat_P(self) -> Vector:
        """Direction of the instrument in the planet-fixed frame."""
        return np.array(self.dynamics.native_value("c_hat_P"))

    @property
    def c_hat_H(self) -> Vector:
        """Direction of the instrument in the Hill frame."""
        return np.array(self.dynamics.native_value("c_hat_H"))

    action_image = call_of("action_image")
    action_downlink = call_of("action_downlink")

    class LocPointTask(Task):
        """Pointing at a location and control of the instrument."""

        name = "locPointTask"

        @default_args(inst_pHat_B=[0, 0, 1])
        def setup_location_pointing(self, inst_pHat_B: Any) -> None:
            """Names the direction of the instrument in body axes."""

        @default_args(imageAttErrorRequirement=0.01, imageRateErrorRequirement=None)
        def setup_instrument_controller(self, imageAttErrorRequirement: float, imageRateErrorRequirement: float) -> None:
            """Names the tolerances of attitude (MRP norm) and rate (rad/s, None: not checked)."""


class ContinuousImagingFSWModel(ImagingFSWModel):
    """Flight software that scans the ground below."""

    action_nadir_scan = call_of("action_nadir_scan")


class SteeringImagerFSWModel(SteeringFSWModel, ImagingFSWModel):
    """Flight software that images targets under MRP steering."""
