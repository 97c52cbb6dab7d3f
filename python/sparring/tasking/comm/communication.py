"""Communication methods. The simulation finds the pairs of satellites that share data."""

from __future__ import annotations

import logging
from copy import copy
from typing import Any

from ..data.nadir_data import ScanningTime
from ..data.no_data import NoData
from ..data.resource_data import ResourceData
from ..data.unique_image_data import UniqueImageData
from ..sim.dyn import LOSCommDynModel
from ..unsupported import sentence
from ..utils.functional import Resetable

logger = logging.getLogger(__name__)

_PACKAGE = __name__
_PLAIN_DATA = {NoData, ResourceData, ScanningTime, UniqueImageData}


class CommunicationMethod(Resetable):
    """Base of communication methods; satellites share data at most once in `min_period` s."""

    def __init__(self, min_period: float = 0.0) -> None:
        self.satellites: list[Any]
        self.min_period = min_period
        self.last_communication_time = 0.0
        self._pairs: list[tuple[int, int]] = []
        self._check()
        if not self.names():
            raise TypeError(f"Can't instantiate abstract class {type(self).__name__}; use a method in `comm`")

    def _check(self) -> None:
        """Raises NotImplementedError if a user's class finds pairs of its own."""
        for base in type(self).__mro__:
            if base.__module__ == _PACKAGE:
                continue
            own = {"communication_pairs", "communicate"} & set(vars(base))
            if own:
                raise NotImplementedError(
                    sentence(
                        f"{base.__name__}.{own.pop()}, a communication method,",
                        "compose the classes in `comm`",
                    )
                )

    def names(self) -> list[str]:
        """Returns the names of the methods that are composed."""
        own = [base for base in type(self).__mro__ if base.__module__ == _PACKAGE]
        return [base.__name__ for base in own if base is not CommunicationMethod]

    def reset_overwrite_previous(self) -> None:
        """Forgets the previous episode."""
        self.last_communication_time = 0.0
        self._pairs = []

    def link_satellites(self, satellites: list[Any]) -> None:
        """Links the method to the satellites of its environment."""
        self.satellites = satellites

    def set_pairs(self, pairs: list[tuple[int, int]]) -> None:
        """Takes the pairs of a step, by number: the first sends to the second."""
        self._pairs = pairs

    def communication_pairs(self) -> list[tuple[Any, Any]]:
        """Returns the pairs of satellites that share data: sender and receiver."""
        return [(self.satellites[a], self.satellites[b]) for a, b in self._pairs]

    def communicate(self) -> None:
        """Shares data between the pairs of the last step."""
        time = self.satellites[0].simulator.sim_time
        if time - self.last_communication_time < self.min_period:
            return
        pairs = self.communication_pairs() if self._pairs else []
        if pairs:
            plural = "s" if len(pairs) > 1 else ""
            logger.info(f"Communicating data in {len(pairs)} direction{plural}.")
        self._end_broadcasts()
        if len(pairs) == len(self.satellites) * (len(self.satellites) - 1):
            self._communicate_all()
        else:
            for sender, receiver in pairs:
                receiver.data_store.stage_communicated_data(sender.data_store.data)
            for satellite in self.satellites:
                satellite.data_store.update_with_communicated_data()
        self.last_communication_time = time

    def _communicate_all(self) -> None:
        """Gives all satellites the data of all."""
        logger.info("Optimizing data communication between all pairs of satellites")
        if len(self.satellites) == 1 and type(self.satellites[0].data_store.data) in _PLAIN_DATA:
            # The sum with no data is the data.
            return
        data = type(self.satellites[0].data_store.data)()
        for satellite in self.satellites:
            data += satellite.data_store.data
        for satellite in self.satellites:
            satellite.data_store.data = copy(data)
            if hasattr(satellite.data_store, "pass_data"):
                satellite.data_store.pass_data()

    def _end_broadcasts(self) -> None:
        """Hook after the pairs of a step are known."""


class NoCommunication(CommunicationMethod):
    """No satellite shares data."""


class FreeCommunication(CommunicationMethod):
    """All satellites share data in every step."""


class LOSCommunication(CommunicationMethod):
    """Satellites share data that saw each other in the step; needs a `LOSCommDynModel`."""

    def link_satellites(self, satellites: list[Any]) -> None:
        """Links the method to satellites, which must see lines of sight."""
        super().link_satellites(satellites)
        for satellite in satellites:
            if not issubclass(satellite.dyn_type, LOSCommDynModel):
                raise TypeError(
                    f"Satellite dynamics type {satellite.dyn_type} must be a subclass of LOSCommDynModel to use LOSCommunication"
                )


class MultiDegreeCommunication(CommunicationMethod):
    """Data travel along chains of the pairs of another method, with which it is composed."""


class LOSMultiCommunication(MultiDegreeCommunication, LOSCommunication):
    """Data travel along chains of lines of sight."""


class BroadcastCommunication(CommunicationMethod):
    """Only satellites that broadcast in the step send, over another method's pairs."""

    def _end_broadcasts(self) -> None:
        """Marks all broadcasts as sent."""
        for satellite in self.satellites:
            for item in satellite.action_builder.action_spec:
                if hasattr(item, "broadcast_pending"):
                    item.broadcast_pending = False
