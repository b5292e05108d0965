/** Settings of the preprocessing chains: name in both languages, meaning in Chinese (English comes from the service). */
interface ChainText {
  readonly en: string;
  readonly zh: string;
  readonly meaning: string;
}

/** By name without the unit at its end or beginning: units differ between sensors. */
export const chainTexts: Readonly<Record<string, ChainText>> = {
  zero_x: { en: "Zero of x", zh: "x 零点", meaning: "x 轴零值对应的原始计数。" },
  zero_y: { en: "Zero of y", zh: "y 零点", meaning: "y 轴零值对应的原始计数。" },
  zero_z: { en: "Zero of z", zh: "z 零点", meaning: "z 轴零值对应的原始计数。" },
  zero: { en: "Zero", zh: "零点", meaning: "零压力对应的原始计数。" },
  per_count: {
    en: "Size of a count",
    zh: "单个计数的大小",
    meaning: "一个原始计数的大小；1 = 板子直接发送该单位。",
  },
  roll: { en: "Mounted: roll", zh: "安装：横滚", meaning: "传感器绕前向轴相对机体转过的角度。" },
  pitch: { en: "Mounted: pitch", zh: "安装：俯仰", meaning: "传感器绕右向轴相对机体转过的角度。" },
  yaw: { en: "Mounted: yaw", zh: "安装：偏航", meaning: "传感器绕下向轴相对机体转过的角度。" },
  limit: { en: "Jump limit", zh: "跳变限制", meaning: "与上一样本相差更大的样本会被其替换；0 = 关闭。" },
  limit_count: {
    en: "Jumps until believed",
    zh: "接受新值所需次数",
    meaning: "连续替换这么多次后接受新的水平。",
  },
  butterworth: {
    en: "Butterworth cut-off",
    zh: "巴特沃斯截止频率",
    meaning: "巴特沃斯低通的截止频率；0 = 关闭；越低越平滑。",
  },
  butterworth_order: {
    en: "Butterworth order",
    zh: "巴特沃斯阶数",
    meaning: "其阶数；越高截止越陡、延迟越大。",
  },
  lowpass: {
    en: "Low-pass cut-off",
    zh: "一阶低通截止频率",
    meaning: "一阶低通的截止频率；0 = 关闭；越低越平滑。",
  },
  window_samples: { en: "Moving mean", zh: "滑动平均", meaning: "对这么多样本取滑动平均；1 = 关闭。" },
  full_scale: {
    en: "End of the range",
    zh: "量程",
    meaning: "量程终点；到此的样本计为削顶；0 = 自动判断或未知。",
  },
  convert: {
    en: "Airspeed from pressure",
    zh: "由压差计算空速",
    meaning: "开：由压差和空气密度计算真空速；关：按板子发送的值。",
  },
};

/** Key of a setting's texts. */
export function chainKey(name: string): string {
  if (name in chainTexts) return name;
  if (name.endsWith("_per_count")) return "per_count";
  return name.replace(/_(counts|deg|hz|rad_s|m_s2|gauss|pa|m)$/, "");
}
