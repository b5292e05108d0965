import type { components } from "./types.gen";

type Schemas = components["schemas"];

export type AidOut = Schemas["AidOut"];
export type BoardIn = Schemas["BoardIn"];
export type BoardOut = Schemas["BoardOut"];
export type BoardsOut = Schemas["BoardsOut"];
export type ChangeOut = Schemas["ChangeOut"];
export type ChainOut = Schemas["ChainOut"];
export type ConsistencyOut = Schemas["ConsistencyOut"];
export type DiffOut = Schemas["DiffOut"];
export type DelayOut = Schemas["DelayOut"];
export type DoctorOut = Schemas["DoctorOut"];
export type EventOut = Schemas["EventOut"];
export type FailureOut = Schemas["FailureOut"];
export type FitOut = Schemas["FitOut"];
export type HealthOut = Schemas["HealthOut"];
export type ImportedOut = Schemas["ImportedOut"];
export type InfoOut = Schemas["InfoOut"];
export type JobOut = Schemas["JobOut"];
export type JobsOut = Schemas["JobsOut"];
export type LaneChoiceOut = Schemas["LaneChoiceOut"];
export type LaneOut = Schemas["LaneOut"];
export type LanesOut = Schemas["LanesOut"];
export type LinkOut = Schemas["LinkOut"];
export type MagLearningOut = Schemas["MagLearningOut"];
export type ParameterOut = Schemas["ParameterOut"];
export type PortOut = Schemas["PortOut"];
export type PortsOut = Schemas["PortsOut"];
export type PreprocessingOut = Schemas["PreprocessingOut"];
export type Problem = Schemas["Problem"];
export type ResidualOut = Schemas["ResidualOut"];
export type SensorOut = Schemas["SensorOut"];
export type SessionOut = Schemas["SessionOut"];
export type SetOut = Schemas["SetOut"];
export type SetsOut = Schemas["SetsOut"];
export type SettingOut = Schemas["SettingOut"];
export type SettingsOut = Schemas["SettingsOut"];
export type SimulatorOut = Schemas["SimulatorOut"];
export type VerdictOut = Schemas["VerdictOut"];

export type Severity = VerdictOut["severity"];
export type LaneStatus = LaneOut["status"];
export type Verdict = ConsistencyOut["verdict"];
export type LinkState = LinkOut["state"];
export type CalKind = JobOut["kind"];
export type CalSensor = JobOut["sensor"];
export type CalGrade = FitOut["grade"];
/** One thing the demo board may be told; fields with a default may be left out. */
export type SimulatorIn =
  | { readonly action: "pose"; readonly face: string }
  | { readonly action: "pose"; readonly down_b: readonly number[] }
  | { readonly action: "pose"; readonly number: number }
  | { readonly action: "spin"; readonly about?: "x" | "y" | "z" }
  | { readonly action: "turntable"; readonly axis: "x" | "y" | "z"; readonly turns: number }
  | { readonly action: "shake" | "fly" | "drop_link" }
  | { readonly action: "magnet" | "room_magnet" | "wind_on_pitot"; readonly is_on: boolean };
/** A calibration to start; what is left out is found out. */
export interface CalibrationWish {
  readonly kind: CalKind;
  readonly options: Partial<Schemas["OptionsIn"]>;
  readonly dry_run: boolean;
}
