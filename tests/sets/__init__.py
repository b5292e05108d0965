"""Readers of the given data sets: each writes the sensor folder of the `replay` contract.

- `broad`: hand-held inertial sensor under an optical reference, eight trials.
- `rtk_drive`: a car with an IMU and an RTK receiver.
- `inertialnav_quad`: two ArduCopter flights; `inertialnav_x8`: a flying wing with aerobatics.
- `umn`: a PX4 fixed wing, without raw inertial data.
"""
