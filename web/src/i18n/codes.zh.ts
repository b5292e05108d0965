/**
 * Cause and remedy by the server's code; `{name}` is filled from the link's details or the verdict's values.
 * A code that is missing here is shown with the server's English sentence.
 */
export const codesZh: Readonly<Record<string, { cause: string; remedy?: string }>> = {
  // link
  opening: { cause: "正在打开链路。", remedy: "请稍候。" },
  "link-opening": { cause: "正在打开链路。", remedy: "请稍候。" },
  "port-busy": {
    cause: "{device} 被 {holder} 占用。",
    remedy: "关闭该程序（地面站、ModemManager 或终端）；端口空闲后会自动接管。",
  },
  "in-use-here": { cause: "{device} 已被本 navdeck 使用。", remedy: "无需处理：它就是已显示的飞控板之一。" },
  "no-permission": {
    cause: "当前用户无权打开 {device}。",
    remedy:
      "将用户加入 {group} 组并重新登录：sudo usermod -aG {group} $USER。容器中请传入设备（devices:）与组（group_add: dialout）。",
  },
  "port-missing": {
    cause: "没有 {device}。",
    remedy: "请用数据线连接飞控板（有些线只能充电），或选择其他端口：navdeck ports 可列出。",
  },
  unplugged: { cause: "{device} 已消失：飞控板被拔出或重启。", remedy: "重新插上即可，端口名变化也能找到。" },
  "other-device": {
    cause: "{identity} 已被拔出，{device} 现在是另一台设备。",
    remedy: "请重新插上原来的板，或重新连接以使用新设备。",
  },
  "not-a-port": { cause: "{device} 不是串口：{error}。", remedy: "请选择其他端口：navdeck ports 可列出。" },
  "baud-refused": {
    cause: "{device} 不支持 {baud} 波特率。",
    remedy: "请使用适配器支持的波特率，如 57600、115200 或 921600。",
  },
  "no-board": {
    cause: "没有插入串口飞控板。",
    remedy: "请用数据线插入飞控板，出现后会自动打开。没有硬件可用演示板：sim:",
  },
  "all-unusable": {
    cause: "有串口，但都无法打开：{ports}。",
    remedy: "关闭占用程序，或授予当前用户权限：navdeck ports 会说明每个端口的原因。",
  },
  silent: {
    cause: "{device} 已打开，但没有字节到达。",
    remedy: "检查飞控板供电、TX 与 RX 是否交叉，以及是否为数传端口。",
  },
  "silent-network": { cause: "{address} 已连接，但没有字节到达。", remedy: "检查对方是否在此端口转发遥测。" },
  "silent-udp": {
    cause: "{address} 没有收到数据报。",
    remedy: "请将飞控板遥测指向此端口。127.0.0.1 只能收到本机数据：其他机器请用 udp://0.0.0.0:{port}。",
  },
  "waiting-for-peer": {
    cause: "尚无设备连接到 {address}。",
    remedy: "让飞控板或网桥连接到此处。127.0.0.1 只接受本机：其他机器请用 tcp-listen://0.0.0.0:{port}。",
  },
  refused: {
    cause: "{address} 拒绝连接：那里没有程序在监听。",
    remedy: "在那里启动飞控板或网桥，或更正端口；会自动重试。",
  },
  "host-not-found": { cause: "未知的主机名 {host}。", remedy: "更正名称，或使用数字地址。" },
  unreachable: {
    cause: "{address} 没有应答：{error}。",
    remedy: "检查网线或 Wi-Fi、地址和防火墙；会自动重试。",
  },
  "address-in-use": {
    cause: "{address} 已被其他程序监听。",
    remedy: "关闭该程序（地面站？），或换一个端口。",
  },
  "address-not-here": {
    cause: "无法在 {address} 监听：{error}。",
    remedy: "使用本机地址、127.0.0.1 或 0.0.0.0，端口大于 1023。",
  },
  "connection-lost": { cause: "与 {address} 的连接被关闭。", remedy: "无需处理：会自动重新连接。" },
  "file-missing": { cause: "没有文件 {path}。", remedy: "更正路径。" },
  "file-unreadable": { cause: "{path} 无法播放：{error}", remedy: "请选择 .tlog 或字节转储文件。" },
  "file-ended": { cause: "{path} 已播放完毕。", remedy: "重新连接可再播放一次，或加上 loop=1。" },
  "link-ended": { cause: "记录已播放完毕。", remedy: "重新连接可再播放一次。" },
  "sim-failed": { cause: "演示飞控板未能启动：{error}。", remedy: "请查看 navdeck doctor。" },
  closed: { cause: "链路已关闭。", remedy: "重新连接即可打开。" },
  "wrong-baud": {
    cause: "以 {baud} 波特率收到字节，但不构成消息：飞控板使用其他波特率。",
    remedy: "请设为飞控板的波特率：数传电台 57600，有线端口 115200 或 921600。",
  },
  "foreign-protocol": {
    cause: "收到的是 {protocol}，不是此飞控板设定的协议。",
    remedy: "请连接飞控板的 MAVLink 端口，或为该设备选择协议。",
  },
  "link-in-use": { cause: "此链路已被另一块飞控板使用。", remedy: "请使用那块飞控板，或先将其移除。" },
  // traffic
  "board-failed": { cause: "该飞控板的任务因故障停止。", remedy: "请重新连接；若再次发生请报告。" },
  "no-frames": { cause: "有字节到达，但不构成消息。", remedy: "检查端口的波特率与协议。" },
  "no-samples": { cause: "飞控板在通信，但尚未发送传感器数据。", remedy: "已请求数据流，请稍候几秒。" },
  "no-data": { cause: "已 {age_s} s 没有传感器数据。", remedy: "检查线缆、电台距离和飞控板供电。" },
  "frames-lost": {
    cause: "{loss_ratio} 的消息在途中丢失。",
    remedy: "降低数据流频率或提高波特率；电台请靠近。",
  },
  "line-noise": {
    cause: "{junk_ratio} 的字节损坏或不属于本协议。",
    remedy: "检查接线和地线；查看是否有其他程序写入此链路。",
  },
  "clock-drift": {
    cause: "飞控板时钟相对本机漂移 {clock_drift_ppm} ppm。",
    remedy: "检查链路是否停顿，或虚拟机时钟是否异常。",
  },
  "interval-refused": {
    cause: "飞控板拒绝了所请求的 HIGHRES_IMU 频率，已改用旧方式按组请求。",
    remedy: "若 IMU 数据正常到达则无需处理；否则请在飞控板上设置数据流频率（ArduPilot：SRn_RAW_SENS = 50）。",
  },
  "interval-unanswered": {
    cause: "飞控板在此端口不应答命令，已改用旧方式按组请求。",
    remedy:
      "检查飞控板接收线是否连接、此端口是否接受命令（ArduPilot：SERIALn_OPTIONS）；否则请在飞控板上设置数据流频率（ArduPilot：SRn_RAW_SENS = 50）。",
  },
  // sensors
  "mag-scale-corrected": {
    cause: "飞控板上报的磁场单位与协议不符；已找到比例并使用。",
    remedy: "无需处理；升级飞控固件可能解决。",
  },
  "mag-scale-unknown": { cause: "上报的磁场不符合任何已知单位。", remedy: "远离铁磁物与电流；校准磁力计。" },
  "mag-field-implausible": { cause: "上报的磁场强度不合理。", remedy: "远离铁磁物与电流；校准磁力计。" },
  "imu-stuck": { cause: "惯性测量单元的数值不再变化。", remedy: "检查飞控板上的传感器，重启飞控板。" },
  "imu-clipped": {
    cause: "惯性测量单元读数达到量程上限：超出部分丢失，估计会漂移。",
    remedy: "改善减振、平衡旋翼，或在飞控板上选择更大的量程。",
  },
  "imu-gaps": { cause: "惯性测量单元的数据有间断。", remedy: "检查链路负载与飞控板负荷。" },
  "imu-missing": {
    cause: "飞控板不发送惯性数据，无法导航。",
    remedy: "请启用其原始传感器数据流（HIGHRES_IMU）。",
  },
  "imu-slow": {
    cause: "惯性数据仅 {rate_hz} Hz，会漏掉快速转动。",
    remedy: "提高数据流频率；端口已满时提高波特率。",
  },
  "sensor-stale": { cause: "{subject}已 {age_s} s 没有新样本。", remedy: "检查飞控板上的{subject}。" },
  // aids
  "aid-refused-gate": {
    cause: "{subject}未被使用：与状态之差超出允许范围。",
    remedy: "检查该传感器，并稍候。",
  },
  "aid-refused-no-fix": {
    cause: "{subject}未被使用：接收机没有定位。",
    remedy: "让天线对天空无遮挡并稍候。",
  },
  "aid-refused-stale": { cause: "{subject}未被使用：到达太晚。", remedy: "查看链路的延迟与丢失。" },
  "aid-refused-repeated": {
    cause: "{subject}未被使用：飞控板重复旧样本。",
    remedy: "检查飞控板上该传感器的接线。",
  },
  "aid-refused-range": { cause: "{subject}未被使用：数值在物理上不可能。", remedy: "检查该传感器及其校准。" },
  "aid-refused-disturbed": { cause: "{subject}未被使用：磁场受扰。", remedy: "远离铁磁物、磁铁与电流。" },
  "aid-refused-order": { cause: "{subject}未被使用：时间戳倒退。", remedy: "检查飞控板时钟与链路。" },
  // estimator
  "lane-failed": { cause: "估计器失效：其状态不再一致。", remedy: "保持载具静止；它会自行重新开始。" },
  "lane-put-aside": {
    cause: "{subject}因故障停止，已被停用。",
    remedy: "请重新启动；若改过设置请恢复，并报告此问题。",
  },
  "magnetic-model-date": {
    cause: "日期超出磁场模型的有效期；使用其 {decimal_year} 年的磁场。",
    remedy: "检查飞控板或设置中的日期，或升级 navdeck。",
  },
  "lane-aligning": { cause: "估计器正在寻找水平与北向。", remedy: "请保持载具静止几秒。" },
  "lane-attitude-only": { cause: "姿态已知，位置未知：尚无卫星定位。", remedy: "让卫星天线对天空无遮挡。" },
  "dead-reckoning": {
    cause: "位置已推算 {dead_reckoning_s} s，没有定位修正；误差在增长。",
    remedy: "恢复卫星定位；不要相信超出所示不确定度的位置。",
  },
  // events
  "link-open": { cause: "链路已通。" },
  "link-silent": { cause: "链路静默：没有字节到达。" },
  aligned: { cause: "对准完成；航向 σ {sigma_heading_rad}，倾斜 σ {sigma_tilt_rad}。" },
  "gnss-reset": { cause: "卫星定位与滤波器矛盾十秒；位置移动 {horizontal_m} m，高度 {down_m} m。" },
  "gnss-lost": { cause: "已 {age_s} s 无卫星定位：航位推算。请检查天线视野。" },
  "gnss-back": { cause: "卫星定位在 {outage_s} s 后恢复；位置相差 {horizontal_m} m。" },
  "yaw-reset": { cause: "航向转动 {yaw_rad}：磁偏角现已知。" },
  "heading-found": { cause: "已由磁场得到航向：{yaw_rad}。" },
  "heading-from-course": { cause: "已由卫星航迹角得到航向：{yaw_rad}。" },
  "filter-failed": { cause: "滤波器数值失效并重新开始；请报告此问题。" },
  "imu-gap": { cause: "{gap_s} s 没有惯性数据：重新对准。请检查链路与飞控板负荷。" },
  "lanes-chosen": { cause: "已选择估计器：{list}。" },
  "lane-parameters-set": { cause: "估计器设置已更改：{list}。" },
  // requests
  "lane-not-running": { cause: "此估计器没有运行。", remedy: "请在“估计器”页打开它。" },
  "no-such-lane": { cause: "没有这个估计器。", remedy: "请重新载入本页。" },
  "bad-lanes": { cause: "估计器的选择无效。", remedy: "至少选择一个，每个只选一次；第一个为主。" },
  "no-such-parameter": { cause: "此估计器没有这个设置。", remedy: "请重新载入本页。" },
  "bad-parameter": { cause: "设置的值无效。", remedy: "请输入所示范围内的值。" },
  "parameter-out-of-range": { cause: "{name} 须在 {low} 到 {high} 之间。", remedy: "请输入所示范围内的值。" },
  "invalid-value": { cause: "有值无效，已被拒绝。", remedy: "请更正后重试。" },
  "board-not-running": { cause: "该飞控板没有在运行，估计器都不工作。", remedy: "请先重新连接。" },
  "board-removed": { cause: "该飞控板已被移除。" },
  "no-such-board": { cause: "没有这块飞控板。", remedy: "请重新选择飞控板。" },
  "no-such-topic": { cause: "服务没有这个数据。", remedy: "请重新载入本页。" },
  "service-unreachable": { cause: "navdeck 没有应答。" },
  "wrong-token": { cause: "此令牌无效。" },
  "too-many-guesses": { cause: "尝试次数过多。", remedy: "请稍候再试。" },
  "too-many-boards": { cause: "飞控板数量已达上限。", remedy: "请移除不需要的飞控板。" },
  "bad-link": { cause: "这不是有效的链路地址。", remedy: "例如：serial:///dev/ttyACM0?baud=921600。" },
  "file-not-allowed": { cause: "只允许打开数据目录中的文件。", remedy: "请把文件放入数据目录。" },

  // calibration
  "calibration-started": { cause: "校准已开始。" },
  "calibration-fitted": { cause: "校准已得出结果。", remedy: "请在“校准”页查看并应用。" },
  "calibration-refused": { cause: "校准没有得出结果。", remedy: "“校准”页说明原因。" },
  "calibration-unreadable": { cause: "无法读取已保存的校准。" },
  "calibration-store-trouble": { cause: "校准存储中有内容被搁置。" },
  "calibration-busy": { cause: "该传感器上已有校准在进行。", remedy: "请等待其结束，或取消它。" },
  "calibration-changed": { cause: "此结果依据的其他校准已改变。", remedy: "请重新进行此校准。" },
  "impossible-calibration": { cause: "这组数值不可能是一次校准。", remedy: "请选择另一组，或重新校准。" },
  "field-unknown": { cause: "尚不知道此处的地磁场。", remedy: "请等待定位，或填写此处的磁场强度。" },
  "heading-unknown": { cause: "需要真航向。", remedy: "请填写相对真北的航向角度。" },
  "wrong-state": { cause: "该校准现在不能这样做。", remedy: "请看本页显示的状态。" },
  "dry-run": { cause: "这是试运行，不会应用。", remedy: "请关闭试运行后重新开始。" },
  "bad-option": { cause: "有选项无效。", remedy: "请更正后重试。" },
  "no-such-job": { cause: "已找不到此校准。", remedy: "请重新开始。" },
  "no-such-set": { cause: "已找不到这组校准。", remedy: "请重新载入本页。" },
  "nothing-before": { cause: "此前没有可回退的校准。" },
  "nothing-in-force": { cause: "该传感器没有生效中的校准。" },
  "set-in-force": { cause: "这组校准正在生效，不能删除。", remedy: "请先撤下或应用另一组。" },
  "set-exists": { cause: "已有相同的一组校准。" },
  "sensor-mismatch": { cause: "两组校准属于不同的传感器。" },
  "store-failed": { cause: "无法写入校准存储。", remedy: "请清理磁盘空间后重试。" },
  "store-busy": { cause: "校准存储被另一个 navdeck 占用。", remedy: "请关闭它，或使用另一个数据目录。" },
  "store-unavailable": { cause: "校准存储不可用。" },
  "unreadable-calibration": { cause: "无法识别该校准文件。", remedy: "请选择其他文件。" },
  "simulator-cannot": { cause: "演示板不能这样做。" },
  "simulator-not-running": { cause: "演示板没有在运行。", remedy: "请先重新连接。" },
  "learning-off": { cause: "没有在学习。", remedy: "请先打开“学习”。" },
};
