import type { components } from "./types.gen";

type Schemas = components["schemas"];

export type AidOut = Schemas["AidOut"];
export type BoardIn = Schemas["BoardIn"];
export type BoardOut = Schemas["BoardOut"];
export type BoardsOut = Schemas["BoardsOut"];
export type ConsistencyOut = Schemas["ConsistencyOut"];
export type DelayOut = Schemas["DelayOut"];
export type DoctorOut = Schemas["DoctorOut"];
export type EventOut = Schemas["EventOut"];
export type HealthOut = Schemas["HealthOut"];
export type InfoOut = Schemas["InfoOut"];
export type LaneChoiceOut = Schemas["LaneChoiceOut"];
export type LaneOut = Schemas["LaneOut"];
export type LanesOut = Schemas["LanesOut"];
export type LinkOut = Schemas["LinkOut"];
export type ParameterOut = Schemas["ParameterOut"];
export type PortOut = Schemas["PortOut"];
export type PortsOut = Schemas["PortsOut"];
export type Problem = Schemas["Problem"];
export type SensorOut = Schemas["SensorOut"];
export type SessionOut = Schemas["SessionOut"];
export type SettingOut = Schemas["SettingOut"];
export type SettingsOut = Schemas["SettingsOut"];
export type VerdictOut = Schemas["VerdictOut"];

export type Severity = VerdictOut["severity"];
export type LaneStatus = LaneOut["status"];
export type Verdict = ConsistencyOut["verdict"];
export type LinkState = LinkOut["state"];
