/** Settings of the estimators: name in both languages, meaning in Chinese (the English one comes from the service). */
interface ParameterText {
  readonly en: string;
  readonly zh: string;
  readonly meaning: string;
  /** English meaning of a setting that is shown as a switch. */
  readonly switched?: string;
}

/** By parameter, or by lane and parameter where a lane means something else by it. A test compares with the server. */
export const parameterTexts: Readonly<Record<string, ParameterText>> = {
  gyro_noise_rad_s_rthz: {
    en: "Gyro noise density",
    zh: "陀螺噪声密度",
    meaning: "载具上陀螺仪的噪声密度；越大越相信辅助量测，越不相信陀螺仪。",
  },
  "kalman_angle_bias.gyro_noise_rad_s_rthz": {
    en: "Gyro noise density",
    zh: "陀螺噪声密度",
    meaning: "陀螺仪的噪声密度；越大越相信加速度计给出的角度。",
  },
  "ahrs_fixed_gain.gyro_noise_rad_s_rthz": {
    en: "Gyro noise density",
    zh: "陀螺噪声密度",
    meaning: "陀螺仪的噪声密度，含刻度误差；越大越快跟随重力、磁场与运动。",
  },
  accel_noise_m_s2_rthz: {
    en: "Accelerometer noise density",
    zh: "加速度计噪声密度",
    meaning: "载具上加速度计的噪声密度；实测振动另行叠加。",
  },
  "nav_position.accel_noise_m_s2_rthz": {
    en: "Acceleration noise density",
    zh: "加速度噪声密度",
    meaning: "加速度的噪声密度，含振动；越大越相信卫星导航。",
  },
  "altitude_kalman.accel_noise_m_s2_rthz": {
    en: "Vertical acceleration noise density",
    zh: "垂直加速度噪声密度",
    meaning: "垂直加速度的噪声密度，含倾斜误差与振动。",
  },
  gyro_bias_walk_rad_s2_rthz: {
    en: "Gyro bias walk",
    zh: "陀螺零偏游走",
    meaning: "陀螺零偏变化的快慢，主要随温度。",
  },
  "kalman_angle_bias.gyro_bias_walk_rad_s2_rthz": {
    en: "Gyro bias walk",
    zh: "陀螺零偏游走",
    meaning: "陀螺零偏变化的快慢；越大跟得越快，也更易把运动当作零偏。",
  },
  "ahrs_fixed_gain.gyro_bias_walk_rad_s2_rthz": {
    en: "Gyro bias walk",
    zh: "陀螺零偏游走",
    meaning: "陀螺零偏变化的快慢；越大学得越快，也更易把运动当作零偏。",
  },
  accel_bias_walk_m_s3_rthz: {
    en: "Accelerometer bias walk",
    zh: "加速度计零偏游走",
    meaning: "加速度计零偏变化的快慢。",
  },
  "altitude_kalman.accel_bias_walk_m_s3_rthz": {
    en: "Acceleration bias walk",
    zh: "加速度零偏游走",
    meaning: "加速度零偏变化的快慢；越大学得越快但越不稳。",
  },
  accel_bias_sigma_m_s2: {
    en: "Accelerometer bias at the start, σ",
    zh: "起始加速度计零偏 σ",
    meaning: "起始时加速度计零偏的标准差；校准之后取小。",
  },
  mag_noise_gauss: {
    en: "Magnetometer noise",
    zh: "磁力计噪声",
    meaning: "磁力计的噪声与未建模的干扰；越大越不相信其航向。",
  },
  mag_bias_sigma_gauss: {
    en: "Field fixed to the body, σ",
    zh: "机体固有磁场 σ",
    meaning: "校准后仍固定在机体上的磁场；取零表示完全相信校准。",
  },
  baro_noise_m: {
    en: "Barometer noise",
    zh: "气压高度噪声",
    meaning: "气压高度的噪声；越大越不相信它。",
  },
  "altitude_kalman.baro_noise_m": {
    en: "Barometer noise",
    zh: "气压高度噪声",
    meaning: "气压高度的噪声，含气流影响；越大越不相信它。",
  },
  gravity_noise_m_s2: {
    en: "Motion that hides gravity",
    zh: "掩盖重力的运动加速度",
    meaning: "没有卫星导航时掩盖重力的加速度；越大越不相信加速度计给出的倾斜。",
  },
  declination_sigma_rad: {
    en: "Declination error, σ",
    zh: "磁偏角误差 σ",
    meaning: "磁场模型的磁偏角误差；取零则保持模型值。",
  },
  gate_sigma: {
    en: "Gate, in σ",
    zh: "门限（σ 的倍数）",
    meaning: "与预测相差超过这么多倍标准差的量测被拒绝。",
  },
  "altitude_kalman.gate_sigma": {
    en: "Gate, in σ",
    zh: "门限（σ 的倍数）",
    meaning: "与预测相差超过这么多倍标准差的气压高度被拒绝。",
  },
  time_constant_s: {
    en: "Time constant",
    zh: "时间常数",
    meaning: "加速度计的角度胜过陀螺仪所需的时间；越大越平滑，漂移也越大。",
  },
  accel_angle_noise_rad_rthz: {
    en: "Noise of the accelerometer's angle",
    zh: "加速度计角度噪声",
    meaning: "加速度计给出的角度的噪声密度，含运动加速度；越大越不相信它。",
  },
  "ahrs_fixed_gain.accel_angle_noise_rad_rthz": {
    en: "Noise of the accelerometer's tilt",
    zh: "加速度计倾斜噪声",
    meaning: "加速度计给出的倾斜的噪声密度，含运动加速度；越大越不相信它。",
  },
  gyro_bias_sigma_rad_s: {
    en: "Gyro bias at the start, σ",
    zh: "起始陀螺零偏 σ",
    meaning: "起始时陀螺零偏的标准差；越大最初几秒学得越快。",
  },
  hold_s: {
    en: "Hold time",
    zh: "保持时间",
    meaning: "最后一个四元数由陀螺仪外推多久之后，姿态视为丢失。",
  },
  tilt_time_constant_s: {
    en: "Time constant of the tilt",
    zh: "倾斜时间常数",
    meaning: "重力修正倾斜所用的时间；越大越少把加速度当作倾斜。",
  },
  heading_time_constant_s: {
    en: "Time constant of the heading",
    zh: "航向时间常数",
    meaning: "磁场修正航向所用的时间；越大越能忽略短暂干扰。",
  },
  bias_time_constant_s: {
    en: "Time constant of the gyro bias",
    zh: "陀螺零偏时间常数",
    meaning: "持续的误差变为陀螺零偏所用的时间；小于其他时间常数的四倍会振荡。",
  },
  mag_angle_noise_rad_rthz: {
    en: "Noise of the magnetic heading",
    zh: "磁航向噪声",
    meaning: "磁航向的噪声密度；越大越不相信它。",
  },
  motion_angle_noise_rad_rthz: {
    en: "Noise of the heading from motion",
    zh: "运动航向噪声",
    meaning: "由 2 m/s² 加速度看出的航向的噪声密度；越大越不相信它。",
  },
  level_angle_noise_rad_rthz: {
    en: "Noise of the tilt without motion",
    zh: "去除运动后的倾斜噪声",
    meaning: "扣除卫星导航加速度后倾斜的噪声密度；越大越不相信它。",
  },
  course_angle_noise_rad_rthz: {
    en: "Noise of the GNSS course",
    zh: "卫星航迹角噪声",
    meaning: "以卫星航迹角作航向时的噪声密度；只用于机头朝向即前进方向的载具。",
  },
  course_speed_m_s: {
    en: "Slowest speed for the course",
    zh: "采用航迹角的最低速度",
    meaning: "航迹角可作航向的最低地速。",
  },
  accel_error_m_s2: {
    en: "Horizontal acceleration error",
    zh: "水平加速度误差",
    meaning: "倾斜误差留下的水平加速度误差的大小：一度为 0.17。",
  },
  accel_error_tau_s: {
    en: "Time the acceleration error lasts",
    zh: "加速度误差的相关时间",
    meaning: "该误差保持相近的时间。",
  },
  accel_error_down_m_s2: {
    en: "Vertical acceleration error",
    zh: "垂直加速度误差",
    meaning: "垂直加速度误差的大小：加速度计的零偏与刻度。",
  },
  gnss_position_m: {
    en: "GNSS position error",
    zh: "卫星水平位置误差",
    meaning: "接收机的水平位置误差；不设则采用其自报值。",
  },
  gnss_height_m: {
    en: "GNSS height error",
    zh: "卫星高度误差",
    meaning: "接收机的高度误差；不设则采用其自报值。",
  },
  gnss_velocity_m_s: {
    en: "GNSS velocity error",
    zh: "卫星速度误差",
    meaning: "接收机的速度误差；不设则采用其自报值，但不小于 0.03 m/s。",
  },
  reaccept_s: {
    en: "Time until refused ones win",
    zh: "重新接受时间",
    meaning: "距上次被采用这么久之后，连续三个被拒绝的量测视为正确，由此重新开始。",
  },
  "altitude_kalman.reaccept_s": {
    en: "Time until refused ones win",
    zh: "重新接受时间",
    meaning: "距上次被采用这么久之后，连续三个被拒绝的高度视为正确，高度转到那里。",
  },
  baro_zero_samples: {
    en: "Samples for the barometer's zero",
    zh: "气压零点样本数",
    meaning: "起始时用于零点平均的气压高度个数；越多越稳。",
  },
  baro_zero_s: {
    en: "Longest time for the zero",
    zh: "零点平均最长时间",
    meaning: "零点平均的最长时间，无论气压计多慢。",
  },
  baro_tau_s: {
    en: "Time constant of the height",
    zh: "高度时间常数",
    meaning: "高度趋于气压高度所用的时间；越长越平滑，越相信加速度计。",
  },
  velocity_tau_s: {
    en: "Time constant of the speed",
    zh: "速度时间常数",
    meaning: "速度趋于气压变化所示值所用的时间；越长越平滑，误差也持续更久。",
  },
  accel_cutoff_hz: {
    en: "Cut-off of the acceleration",
    zh: "加速度截止频率",
    meaning: "垂直加速度低通的截止频率；越低越能去除振动，延迟也越大。",
  },
  offset_tau_s: {
    en: "Time constant of the offset",
    zh: "偏移时间常数",
    meaning: "加速度偏移的平均时间；越短学得越快，也会忘掉真实运动。",
  },
  baro_weight_per_s: {
    en: "Weight of the barometer",
    zh: "气压计权重",
    meaning: "气压计相对加速度计的权重；越大越快跟随气压计。",
  },
  accel_bias_weight_per_s: {
    en: "Weight of the accelerometer bias",
    zh: "加速度计零偏权重",
    meaning: "学习加速度计零偏的快慢；应远小于气压计的权重。",
  },
  jerk_noise_m_s3_rthz: {
    en: "Jerk noise density",
    zh: "加加速度噪声密度",
    meaning: "真实加速度变化的快慢；越大越快跟随机动，延迟小而噪声大。",
  },
  tau_accel_s: {
    en: "Time constant of the tilt",
    zh: "倾斜时间常数",
    meaning: "倾斜修正的时间常数；越大越少把加速度当作倾斜。",
  },
  tau_mag_s: {
    en: "Time constant of the heading",
    zh: "航向时间常数",
    meaning: "磁航向修正的时间常数；越大越能忽略短暂干扰。",
  },
  motion_bias: {
    en: "Gyro bias learned in motion",
    zh: "运动中估计陀螺零偏",
    switched: "On: the gyro bias is estimated in motion too.",
    meaning: "打开时在运动中也估计陀螺零偏。",
  },
  rest_bias: {
    en: "Gyro bias learned at rest",
    zh: "静止时估计陀螺零偏",
    switched: "On: the gyro bias is estimated at rest.",
    meaning: "打开时在静止时估计陀螺零偏。",
  },
  mag_rejection: {
    en: "Unusual fields ignored",
    zh: "忽略异常磁场",
    switched: "On: a field of unusual strength or dip is ignored.",
    meaning: "打开时忽略强度或倾角异常的磁场。",
  },
  rest_gyro_rad_s: {
    en: "Rate change that counts as rest",
    zh: "静止判据：角速率变化",
    meaning: "仍算静止的最大角速率变化；越大越早判为静止。",
  },
  rest_accel_m_s2: {
    en: "Force change that counts as rest",
    zh: "静止判据：比力变化",
    meaning: "仍算静止的最大比力变化；越大越早判为静止。",
  },
  mag_timing_s: {
    en: "How well the magnetometer's delay is known",
    zh: "磁力计延迟的不确定度",
    meaning: "磁力计延迟已知到什么程度；载具转动时据此放大磁场噪声。",
  },
  gnss_wander_m: {
    en: "Receiver's slow position error",
    zh: "接收机位置慢变误差",
    meaning: "接收机每个水平轴上的慢变误差；不填则取自接收机自报精度，载波相位解为零。",
  },
  gnss_wander_tau_s: {
    en: "Duration of the slow position error",
    zh: "位置慢变误差持续时间",
    meaning: "接收机慢变误差的持续时间。",
  },
  gnss_jitter_m: {
    en: "Receiver's quick position error",
    zh: "接收机位置快变误差",
    meaning: "接收机每个水平轴上的快变误差；不填则由定位结果学得。",
  },
  gnss_jitter_tau_s: {
    en: "Duration of the quick position error",
    zh: "位置快变误差持续时间",
    meaning: "给定快变误差的持续时间；零表示每次定位各自独立。",
  },
  gnss_speed_m_s: {
    en: "Receiver's velocity error",
    zh: "接收机速度误差",
    meaning: "接收机每个轴上的速度误差；不填则由定位结果学得。",
  },
  gnss_speed_tau_s: {
    en: "Duration of the velocity error",
    zh: "速度误差持续时间",
    meaning: "给定速度误差的持续时间；零表示每次定位各自独立。",
  },
  baro_drift_m_rts: {
    en: "Drift of the baro's zero",
    zh: "气压零点漂移",
    meaning: "气压高度的零点随天气与气流漂移的快慢。",
  },
  field_sigma: {
    en: "Error of the field model",
    zh: "磁场模型误差",
    meaning: "地磁模型强度与倾角及传感器刻度的误差，占磁场的比例。",
  },
  field_walk_gauss_rts: {
    en: "Change of the Earth field",
    zh: "地磁场变化",
    meaning: "沿途地磁场变化的快慢。",
  },
  mag_bias_walk_gauss_rts: {
    en: "Wander of the body's own field",
    zh: "载具自身磁场游走",
    meaning: "固定于载具的磁场随电流与温度变化的快慢。",
  },
  zero_rate_rad_s: {
    en: "Rotation left at rest",
    zh: "静止时残余角速率",
    meaning: "静止的飞控板仍有的转动，含噪声。",
  },
  zero_velocity_m_s: {
    en: "Velocity left at rest",
    zh: "静止时残余速度",
    meaning: "静止的载具仍有的速度。",
  },
  gyro_scale: {
    en: "Gyro scale error",
    zh: "陀螺刻度误差",
    meaning: "陀螺刻度误差，占角速率的比例；零则归入载具类别的噪声。",
  },
  gyro_cross: {
    en: "Gyro cross-axis error",
    zh: "陀螺交叉轴误差",
    meaning: "陀螺横轴感到的转动，占角速率的比例；零则归入噪声。",
  },
  drag_sigma_m_s2: {
    en: "Unexplained drag",
    zh: "阻力残差",
    meaning: "多旋翼横向比力中阻力未能解释的部分；零则不用阻力。",
  },
  gyro_bias_per_k_rad_s: {
    en: "Gyro bias per kelvin",
    zh: "陀螺零偏温度系数",
    meaning: "每开尔文温度变化引起的陀螺零偏；仅在板温变化时起作用。",
  },
  accel_bias_per_k_m_s2: {
    en: "Accelerometer bias per kelvin",
    zh: "加计零偏温度系数",
    meaning: "每开尔文温度变化引起的加速度计零偏；仅在板温变化时起作用。",
  },
  vibration_hz: {
    en: "Bandwidth of vibration",
    zh: "振动带宽",
    meaning: "实测振动按此带宽折算为噪声；能被平均掉的嗡鸣可取大。",
  },
};
