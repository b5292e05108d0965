import type { Signal } from "./signals";

/** Column of a signal in a file: where it is from, its name there, and the unit it is written in. */
export function wireTitle({ id, group, source, unit }: Signal): string {
  const name = group === "aids" ? id.replace(/^aids#\d+/, `aids/${source}`) : id;
  return unit ? `${name} [${unit}]` : name;
}

/** What of a plot's file name says which plot it was: plain letters, whatever the language. */
export function fileStem(signal: Signal | undefined): string {
  if (!signal) return "";
  const source = signal.group === "lane" ? "" : signal.source || "filtered";
  const than = signal.against === undefined ? "" : `minus-${signal.against.replace("lanes/", "")}`;
  return [source, signal.wireName, than].filter(Boolean).join("-");
}
