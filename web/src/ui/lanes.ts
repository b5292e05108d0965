import type { LaneChoiceOut } from "../api/wire";
import { crc32 } from "../logic/crc32";
import { theme } from "./theme.svelte";

/** The same colours as `server/view3d/palette.py`: in 3D, plots and tables alike (a test compares them). */
export const LANE_COLOURS: Readonly<Record<"dark" | "light", Readonly<Record<string, string>>>> = {
  dark: {
    ins_ekf: "#59a0f9",
    complementary: "#9cf4ce",
    nav_position: "#f0e150",
    onboard: "#de9632",
    reference: "#de50af",
    smoother: "#00905a",
    complementary_1: "#22f0fd",
    kalman_angle_bias: "#e24632",
    dmp: "#a46bf5",
    ahrs_fixed_gain: "#e2fd84",
    vqf: "#aeaeae",
    altitude_complementary: "#e49e22",
    altitude_inertial: "#81dcff",
    altitude_kalman: "#7a77ba",
  },
  light: {
    ins_ekf: "#1e55a0",
    complementary: "#008474",
    nav_position: "#7a7424",
    onboard: "#7d460b",
    reference: "#a0148c",
    smoother: "#00321e",
    complementary_1: "#1590a1",
    kalman_angle_bias: "#a04632",
    dmp: "#6928b0",
    ahrs_fixed_gain: "#738737",
    vqf: "#3a3a3a",
    altitude_complementary: "#796006",
    altitude_inertial: "#1d487c",
    altitude_kalman: "#bc60e1",
  },
};
export const SPARE_COLOURS = ["#009e73", "#d55e00", "#f0e442", "#9678d2", "#8c8c8c"] as const;

export type Provides = LaneChoiceOut["provides"];

/** What a lane estimates: known here too, so that a line keeps its pattern before the service has spoken. */
export const LANE_KINDS: Readonly<Record<string, Provides>> = {
  ins_ekf: "full",
  complementary: "full",
  nav_position: "full",
  onboard: "full",
  reference: "full",
  smoother: "full",
  complementary_1: "attitude",
  kalman_angle_bias: "attitude",
  dmp: "attitude",
  ahrs_fixed_gain: "attitude",
  vqf: "attitude",
  altitude_complementary: "altitude",
  altitude_inertial: "altitude",
  altitude_kalman: "altitude",
};

/** Solid, dashed, dotted by what a lane estimates, in px of a line 1.5 px wide: colours repeat only across kinds. */
export const DASHES: Readonly<Record<Provides, readonly number[]>> = {
  full: [],
  attitude: [8, 4],
  altitude: [2, 3],
};

/** Colour of a lane in the theme shown, the same in every session and on every screen. */
export function laneColour(lane: string): string {
  return LANE_COLOURS[theme.applied][lane] ?? (SPARE_COLOURS[crc32(lane) % SPARE_COLOURS.length] as string);
}

/** Dash pattern of a lane's lines, px; empty = solid. */
export function laneDash(lane: string): readonly number[] {
  return DASHES[LANE_KINDS[lane] ?? "full"];
}
