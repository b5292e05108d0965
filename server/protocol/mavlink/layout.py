"""The decoder's state: one array of int64 and one of float64, with a name for every place in them.

Slots before `S_BOOT_FIRST_SLOT` belong to the link, the rest to one power-up of the board and are forgotten with it.
"""

from __future__ import annotations

from typing import Final

NONE: Final = -1

# Link: filter, lock, boot.
S_WANT_SYSTEM: Final = 0  # filter from the settings, NONE = any
S_WANT_COMPONENT: Final = 1
S_SYSTEM: Final = 2  # the sender that is listened to, NONE = not chosen yet
S_COMPONENT: Final = 3
S_BOOT: Final = 4
S_FILTERED: Final = 5  # frames of other senders
S_REPEATED_IMU: Final = 6  # IMU samples with a stamp that was there already
S_REPEATED_OTHER: Final = 7  # magnetometer, baro, GNSS samples equal to the last
S_HELD: Final = 8  # stamps that did not fit and were not believed
S_CANDIDATE_SYSTEM: Final = 9  # first sender of IMU data, as long as no autopilot has sent a heartbeat
S_CANDIDATE_COMPONENT: Final = 10
S_CANDIDATE_T: Final = 11
S_RIVAL_SYSTEM: Final = 12  # another autopilot that sends heartbeats while the chosen sender is silent
S_RIVAL_COMPONENT: Final = 13
S_RIVAL_BEATS: Final = 14
S_GAP: Final = 15  # frames counted as lost since the last believed stamp: forgotten when it was a reboot
S_PY: Final = 16  # number of frames left for Python by the last call
S_ROWS: Final = 17  # number of rows written by the last call
S_AUTOPILOT: Final = 18  # MAV_AUTOPILOT and MAV_TYPE of the chosen sender, NONE before its heartbeat
S_TYPE: Final = 19

# One power-up.
S_BOOT_FIRST_SLOT: Final = 20
S_T_FIRST: Final = 20  # first and newest believed stamp, ns, NONE before
S_T_LAST: Final = 21
S_SUSPECT_T: Final = 22  # newest stamp of a run that does not fit
S_SUSPECTS: Final = 23
S_PROFILE: Final = 24  # 0 = not known, 1 = to be emitted before the next row, 2 = emitted
S_IMU_SOURCE: Final = 25  # rank in use, 0 = none; each followed by its newest stamp
S_MAG_SOURCE: Final = 27
S_BARO_SOURCE: Final = 29
S_ATT_SOURCE: Final = 31
S_T_IMU: Final = 33  # newest emitted IMU stamp
S_T_ATT: Final = 34  # newest ATTITUDE_QUATERNION (else ATTITUDE) stamp: SIM_STATE's
S_T_REFERENCE: Final = 35
S_GNSS_USEC: Final = 36
S_GNSS_FIX: Final = 37
S_T_NO_FIX: Final = 38
S_HAS_AIRSPEED: Final = 39
S_EPOCH_BASE: Final = 40  # ns to take off UNIX stamps of IMU messages, NONE before
S_SIZE: Final = 41

# Floats: newest emitted values, NaN before.
V_MAG: Final = 0
V_BARO: Final = 3
V_AIRSPEED: Final = 4
V_YEAR: Final = 5
V_SIZE: Final = 6

# Rank of the sources of one quantity, higher is better.
RANK_HIGHRES: Final = 5
RANK_RAW: Final = 4
RANK_SCALED: Final = 3
RANK_SCALED2: Final = 2
RANK_SCALED3: Final = 1
RANK_PRESSURE: Final = 1
RANK_QUATERNION: Final = 5
RANK_EULER: Final = 1
RANK_BEST: Final = 5

# Message ids the decoder knows.
HEARTBEAT: Final = 0
SYS_STATUS: Final = 1
SYSTEM_TIME: Final = 2
GPS_RAW_INT: Final = 24
SCALED_IMU: Final = 26
RAW_IMU: Final = 27
SCALED_PRESSURE: Final = 29
ATTITUDE: Final = 30
ATTITUDE_QUATERNION: Final = 31
GLOBAL_POSITION_INT: Final = 33
COMMAND_ACK: Final = 77
HIGHRES_IMU: Final = 105
SIM_STATE: Final = 108
TIMESYNC: Final = 111
SCALED_IMU2: Final = 116
SCALED_IMU3: Final = 129
STATUSTEXT: Final = 253

AUTOPILOT_ARDUPILOT: Final = 3
AUTOPILOT_INVALID: Final = 8
TYPE_GCS: Final = 6

EPOCH_USEC: Final = 100_000_000_000_000
"""A stamp above this (three years) is UNIX time, not time since power-up."""
