/**
 * Column names of the binary rows, equal to the tuples of `server/nav/types.py` (a test compares them).
 * The server repeats them when it accepts a subscription; these are for choosing signals beforehand.
 */
export const LANE_COLUMNS = [
  "q_w",
  "q_x",
  "q_y",
  "q_z",
  "vel_n_m_s",
  "vel_e_m_s",
  "vel_d_m_s",
  "lat_deg",
  "lon_deg",
  "alt_m",
  "sigma_att_x_rad",
  "sigma_att_y_rad",
  "sigma_att_z_rad",
  "sigma_vel_n_m_s",
  "sigma_vel_e_m_s",
  "sigma_vel_d_m_s",
  "sigma_pos_n_m",
  "sigma_pos_e_m",
  "sigma_pos_d_m",
  "gyro_bias_x_rad_s",
  "gyro_bias_y_rad_s",
  "gyro_bias_z_rad_s",
  "accel_bias_x_m_s2",
  "accel_bias_y_m_s2",
  "accel_bias_z_m_s2",
  "status",
  "pos_n_m",
  "pos_e_m",
  "pos_d_m",
  "dead_reckoning_s",
] as const;

export const STEP_COLUMNS = [
  "gyro_x_rad_s",
  "gyro_y_rad_s",
  "gyro_z_rad_s",
  "accel_x_m_s2",
  "accel_y_m_s2",
  "accel_z_m_s2",
  "mag_x_gauss",
  "mag_y_gauss",
  "mag_z_gauss",
  "baro_alt_m",
  "airspeed_m_s",
  "vibration_m_s2",
  "temperature_degc",
  "imu_samples",
] as const;

export const AID_COLUMNS = [
  "aid",
  "status",
  "observation_0",
  "observation_1",
  "observation_2",
  "predicted_0",
  "predicted_1",
  "predicted_2",
  "innovation_0",
  "innovation_1",
  "innovation_2",
  "innovation_var_0",
  "innovation_var_1",
  "innovation_var_2",
  "test_ratio",
  "t_valid_ns",
] as const;

const POSE_COLUMNS = [
  "q_w",
  "q_x",
  "q_y",
  "q_z",
  "lat_deg",
  "lon_deg",
  "alt_m",
  "vel_n_m_s",
  "vel_e_m_s",
  "vel_d_m_s",
] as const;

export const SAMPLE_COLUMNS = {
  imu: [
    "gyro_x_rad_s",
    "gyro_y_rad_s",
    "gyro_z_rad_s",
    "accel_x_m_s2",
    "accel_y_m_s2",
    "accel_z_m_s2",
    "temperature_degc",
  ],
  mag: ["mag_x_gauss", "mag_y_gauss", "mag_z_gauss"],
  baro: ["pressure_pa", "altitude_m", "temperature_degc"],
  gnss: [
    "lat_deg",
    "lon_deg",
    "alt_m",
    "vel_n_m_s",
    "vel_e_m_s",
    "vel_d_m_s",
    "h_acc_m",
    "v_acc_m",
    "s_acc_m_s",
    "fix_type",
    "satellites",
  ],
  airspeed: ["diff_pressure_pa", "tas_m_s", "temperature_degc"],
  reference: POSE_COLUMNS,
  onboard: POSE_COLUMNS,
} as const;

export type SensorKind = keyof typeof SAMPLE_COLUMNS;

/** Stages of a sensor's preprocessing, in order. */
export const STAGES = ["calibrated", "limited", "filtered"] as const;
export type Stage = (typeof STAGES)[number];

function stages(unit: string, axes: readonly string[]): readonly string[] {
  return STAGES.flatMap((stage) => axes.map((axis) => `${stage}${axis}_${unit}`));
}

export const STAGE_COLUMNS = {
  gyro: stages("rad_s", ["_x", "_y", "_z"]),
  accel: stages("m_s2", ["_x", "_y", "_z"]),
  mag: stages("gauss", ["_x", "_y", "_z"]),
  baro: stages("m", [""]),
  airspeed: [...stages("pa", [""]), "airspeed_m_s"],
} as const;
export type ChainSensor = keyof typeof STAGE_COLUMNS;

/** `LaneStatus` of the server, by value. */
export const LANE_STATUS = ["aligning", "attitude", "navigating", "dead_reckoning", "failed"] as const;
export type LaneStatus = (typeof LANE_STATUS)[number];

/** `Aid` of the server, by value. */
export const AIDS = [
  "gnss_position",
  "gnss_velocity",
  "baro_height",
  "mag_field",
  "zero_velocity",
  "zero_rate",
  "airspeed",
  "sideslip",
  "gravity",
  "gnss_course",
  "wheels",
  "yaw",
  "drag",
] as const;
export type AidName = (typeof AIDS)[number];

/** `AidStatus` of the server, by value. */
export const AID_STATUS = [
  "fused",
  "refused_gate",
  "refused_repeated",
  "refused_stale",
  "refused_no_fix",
  "refused_range",
  "refused_disabled",
  "refused_withheld",
  "refused_not_ready",
  "refused_disturbed",
  "refused_moving",
  "refused_order",
] as const;
export type AidStatusName = (typeof AID_STATUS)[number];
