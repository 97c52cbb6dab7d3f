"""Communication of data between satellites at the end of a step."""

from .communication import (
    BroadcastCommunication,
    CommunicationMethod,
    FreeCommunication,
    LOSCommunication,
    LOSMultiCommunication,
    MultiDegreeCommunication,
    NoCommunication,
)

__all__ = [
    "BroadcastCommunication",
    "CommunicationMethod",
    "FreeCommunication",
    "LOSCommunication",
    "LOSMultiCommunication",
    "MultiDegreeCommunication",
    "NoCommunication",
]
