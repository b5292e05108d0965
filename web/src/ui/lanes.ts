import { crc32 } from "../logic/crc32";
import { theme } from "./theme.svelte";

/** The same colours as `server/view3d/palette.py`: in 3D, plots and tables alike (a test compares them). */
export const LANE_COLOURS: Readonly<Record<"dark" | "light", Readonly<Record<string, string>>>> = {
  dark: { ins_ekf: "#56b4e9", onboard: "#e69f00", reference: "#ee5fd9" },
  light: { ins_ekf: "#0072b2", onboard: "#a86400", reference: "#b3129f" },
};
export const SPARE_COLOURS = ["#009e73", "#d55e00", "#f0e442", "#9678d2", "#8c8c8c"] as const;

/** Colour of a lane in the theme shown, the same in every session and on every screen. */
export function laneColour(lane: string): string {
  return LANE_COLOURS[theme.applied][lane] ?? (SPARE_COLOURS[crc32(lane) % SPARE_COLOURS.length] as string);
}
