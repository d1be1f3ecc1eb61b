"""Ranks of MPI: a communicator, and which rows each rank has."""

from .communicator import SERIAL as SERIAL
from .communicator import Communicator as Communicator
from .communicator import collective as collective
from .communicator import current as current
