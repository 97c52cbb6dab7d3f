"""Payload of a satellite: instrument, storage, transmitter and ground stations."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from ...messaging import DataStorageStatusMsgPayload, Message
from ...utils.elements import REQ_EARTH
from ...utils.functional import aliveness_checker, default_args
from .. import world
from ..model_names import software_names
from ..parameters import FixedAttribute, Parameters
from .basic import BasicDynamicsModel

#: Partition of the data that a satellite has at the start.
_INITIAL_DATA = "STORED DATA"


class ImagingDynModel(BasicDynamicsModel):
    """Satellite with an instrument for targets, storage and a transmitter."""

    storageUnitValidCheck = FixedAttribute()
    #: Partition of an instrument that no flight software commands.
    _own_partition: str | None = None

    @property
    def storage_level(self) -> float:
        """Level of stored data, bits."""
        if self.is_overwritten:
            return float(self.storageUnit.storageUnitDataOutMsg.read().storageLevel)
        return self.native_number("storage_level")

    @property
    def storage_level_fraction(self) -> float:
        """Stored data as a share of the capacity."""
        return self.storage_level / float(self.storageUnit.storageCapacity)

    def _setup_dynamics_objects(self, **kwargs: Any) -> None:
        super()._setup_dynamics_objects(**kwargs)
        self.setup_instrument_power_sink(**kwargs)
        self.setup_transmitter_power_sink(**kwargs)
        self.setup_instrument(**kwargs)
        self.setup_transmitter(**kwargs)
        self.setup_storage_unit(**kwargs)
        self.setup_imaging_target(**kwargs)

    @default_args(instrumentBaudRate=8e6)
    def setup_instrument(self, instrumentBaudRate: float, **kwargs: Any) -> None:
        """Sets up the instrument; `instrumentBaudRate` is the size of an image in bits."""
        self.instrument = Parameters(nodeBaudRate=instrumentBaudRate / self.dyn_rate)

    @default_args(transmitterBaudRate=-8e6, transmitterNumBuffers=100, transmitterPacketSize=None)
    def setup_transmitter(
        self,
        transmitterBaudRate: float,
        instrumentBaudRate: float,
        transmitterNumBuffers: int,
        transmitterPacketSize: float | None = None,
        **kwargs: Any,
    ) -> None:
        """Sets up the transmitter: rate in bit/s, negative, and packets in bits.

        A packet has the size of an image if none is given.
        """
        if transmitterBaudRate > 0:
            self.logger.warning("transmitterBaudRate should probably be negative.")
        packet = -instrumentBaudRate if transmitterPacketSize is None else transmitterPacketSize
        self.transmitter = Parameters(nodeBaudRate=transmitterBaudRate, packetSize=packet, numBuffers=transmitterNumBuffers)

    @default_args(instrumentPowerDraw=-30.0)
    def setup_instrument_power_sink(self, instrumentPowerDraw: float, **kwargs: Any) -> None:
        """Sets up the power of the instrument, W, negative for a draw."""
        if instrumentPowerDraw > 0:
            self.logger.warning("instrumentPowerDraw should probably be zero or negative.")
        self.instrumentPowerSink = Parameters(nodePowerOut=instrumentPowerDraw)

    @default_args(transmitterPowerDraw=-15.0)
    def setup_transmitter_power_sink(self, transmitterPowerDraw: float, **kwargs: Any) -> None:
        """Sets up the power of the transmitter, W, negative for a draw."""
        if transmitterPowerDraw > 0:
            self.logger.warning("transmitterPowerDraw should probably be zero or negative.")
        self.transmitterPowerSink = Parameters(nodePowerOut=transmitterPowerDraw)

    @default_args(dataStorageCapacity=20 * 8e6, bufferNames=None, storageUnitValidCheck=False, storageInit=0)
    def setup_storage_unit(
        self,
        dataStorageCapacity: float,
        storageUnitValidCheck: bool,
        storageInit: float,
        transmitterNumBuffers: int | None = None,
        bufferNames: Sequence[str] | None = None,
        **kwargs: Any,
    ) -> None:
        """Sets up the storage: capacity and initial level in bits, and names of partitions.

        With `storageUnitValidCheck`, the satellite dies if the storage is over its capacity.
        """
        if bufferNames is not None and transmitterNumBuffers not in (None, len(bufferNames)):
            raise ValueError("transmitterNumBuffers cannot be different than len(bufferNames).")
        count = transmitterNumBuffers or 0
        names = [str(number) for number in range(count)] if bufferNames is None else bufferNames
        self._add_storage(dataStorageCapacity, storageUnitValidCheck, list(names))
        if storageInit != 0:
            self._warn_of_storage(dataStorageCapacity, storageInit)
            self._partitions.append(_INITIAL_DATA)
        if not any("Imaging" in name for name in software_names(self.satellite.fsw_type)):
            # An instrument without commands records into a partition of its own.
            self._own_partition = f"Instrument{self.satellite.name}"
            self._partitions.append(self._own_partition)

    def _add_storage(self, capacity: float, is_checked: bool, partitions: list[str]) -> None:
        """Adds the storage unit of a capacity in bits, with named partitions."""
        self.storageUnitValidCheck = is_checked
        self._partitions = partitions
        self.storageUnit = Parameters(storageCapacity=int(capacity), storageUnitDataOutMsg=Message(self._storage, self))

    def _warn_of_storage(self, capacity: float, initial: float) -> None:
        """Warns of an initial level in bits that the storage cannot have."""
        if initial > capacity or initial < 0:
            self.logger.warning(f"Initial storage level {initial} incompatible with its capacity {capacity}.")

    def _storage(self) -> DataStorageStatusMsgPayload:
        """Payload of the storage's state."""
        return DataStorageStatusMsgPayload(
            storageLevel=self.native_number("storage_level"),
            storageCapacity=self.storageUnit.storageCapacity,
            storedData=self._stored_data(),
            storedDataName=self._partitions,
        )

    def _stored_data(self) -> list[float]:
        """Bits by partition: images are in the first or in one of their own, the initial data in the last one but that."""
        satellite = self.satellite
        images, others = satellite.simulator.native.stored(satellite.index)
        if len(self._partitions) == 1:
            return [images + others]
        if self._own_partition is not None:
            return [*[0.0] * (len(self._partitions) - 2), others, images]
        return [images, *[0.0] * (len(self._partitions) - 2), others]

    @aliveness_checker
    def data_storage_valid(self) -> bool:
        """Returns whether the storage is within its capacity, if that is checked."""
        if not self.storageUnitValidCheck:
            return True
        capacity = self.storageUnit.storageCapacity
        return self.storage_level < capacity or bool(np.isclose(self.storage_level, capacity))

    @default_args(
        groundLocationPlanetRadius=REQ_EARTH * 1e3,
        imageTargetMinimumElevation=np.radians(45.0),
        imageTargetMaximumRange=-1,
    )
    def setup_imaging_target(
        self,
        groundLocationPlanetRadius: float,
        imageTargetMinimumElevation: float,
        imageTargetMaximumRange: float,
        **kwargs: Any,
    ) -> None:
        """Sets up access to targets: minimum elevation in rad, largest range in m (-1: none)."""
        self.imagingTarget = Parameters(
            planetRadius=groundLocationPlanetRadius,
            minimumElevation=imageTargetMinimumElevation,
            maximumRange=imageTargetMaximumRange,
        )


class ContinuousImagingDynModel(ImagingDynModel):
    """Satellite whose instrument scans the ground below it into one buffer."""

    @default_args(instrumentBaudRate=8e6)
    def setup_instrument(self, instrumentBaudRate: float, **kwargs: Any) -> None:
        """Sets up the instrument; `instrumentBaudRate` is in bit/s."""
        self.instrument = Parameters(nodeBaudRate=instrumentBaudRate)

    @default_args(dataStorageCapacity=20 * 8e6, storageUnitValidCheck=False, storageInit=0)
    def setup_storage_unit(  # type: ignore[override]
        self,
        dataStorageCapacity: float,
        storageUnitValidCheck: bool,
        storageInit: float,
        **kwargs: Any,
    ) -> None:
        """Sets up the storage: capacity and initial level in bits."""
        self._warn_of_storage(dataStorageCapacity, storageInit)
        self._add_storage(dataStorageCapacity, storageUnitValidCheck, [_INITIAL_DATA])

    @default_args(imageTargetMaximumRange=-1)
    def setup_imaging_target(  # type: ignore[override]
        self, imageTargetMaximumRange: float = -1, **kwargs: Any
    ) -> None:
        """Sets up access to the ground below: largest range to the Earth's centre in m."""
        self.imagingTarget = Parameters(
            planetRadius=0.0,
            minimumElevation=np.radians(-90),
            maximumRange=imageTargetMaximumRange,
        )


class GroundStationDynModel(ImagingDynModel):
    """Satellite that sends data to the world's ground stations."""

    @classmethod
    def _requires_world(cls) -> list[type]:
        return [*super()._requires_world(), world.GroundStationWorldModel]

    def _setup_dynamics_objects(self, **kwargs: Any) -> None:
        super()._setup_dynamics_objects(**kwargs)
        self.setup_ground_station_locations()

    def setup_ground_station_locations(self) -> None:
        """Adds the ground stations to the satellite's opportunities."""
        add_location = getattr(self.satellite, "add_location_for_access_checking", None)
        if add_location is None:
            return
        for station in self.world.groundStations:
            add_location(
                object=station.ModelTag,
                r_LP_P=station.position,
                min_elev=station.minimumElevation,
                type="ground_station",
            )
