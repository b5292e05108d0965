import { fixed } from "../logic/format";
import { recall, remember } from "../logic/storage";
import { codesZh } from "./codes.zh";
import { en } from "./en";
import { zh } from "./zh";

export type Key = keyof typeof en;
export type Catalogue = Readonly<Record<Key, string>>;
export type Language = "en" | "zh";

/** Names between braces in a text, as a type: a missing or misspelt parameter does not compile. */
type Names<Text extends string> = Text extends `${string}{${infer Name}}${infer Rest}`
  ? Name | Names<Rest>
  : never;
type Args<K extends Key> = [Names<(typeof en)[K]>] extends [never]
  ? []
  : [params: Readonly<Record<Names<(typeof en)[K]>, string | number>>];

const CATALOGUES: Readonly<Record<Language, Catalogue>> = { en, zh };

function firstLanguage(): Language {
  const chosen = recall("language", "");
  if (chosen === "en" || chosen === "zh") return chosen;
  return typeof navigator !== "undefined" && navigator.language.toLowerCase().startsWith("zh") ? "zh" : "en";
}

class Speech {
  language = $state<Language>(firstLanguage());

  toggle(): void {
    this.language = this.language === "en" ? "zh" : "en";
    remember("language", this.language);
  }
}

export const speech = new Speech();

/** Return the text in the chosen language; reading it in a component follows a change of language. */
export function t<K extends Key>(key: K, ...[params]: Args<K>): string {
  return fill(CATALOGUES[speech.language][key], params ?? {});
}

/** Like `t` for a key composed at run time: undefined when the catalogue has no such key. */
export function tMaybe(
  key: string,
  params: Readonly<Record<string, string | number>> = {},
): string | undefined {
  return key in en ? fill(CATALOGUES[speech.language][key as Key], params) : undefined;
}

export function fill(text: string, params: Readonly<Record<string, string | number>>): string {
  return text.replace(/\{(\w+)\}/g, (whole, name: string) => String(params[name] ?? whole));
}

export type Details = Readonly<Record<string, string | number | null>>;

/**
 * What the server says with a code: our words where the catalogue has them and every name in them is known,
 * else its own English sentence.
 */
export function spoken(
  code: string,
  cause: string,
  remedy: string,
  details: Details = {},
): { cause: string; remedy: string } {
  const known = speech.language === "zh" ? codesZh[code] : undefined;
  if (!known) return { cause, remedy };
  return {
    cause: filled(known.cause, details) ?? cause,
    remedy: (known.remedy === undefined ? undefined : filled(known.remedy, details)) ?? remedy,
  };
}

function filled(text: string, details: Details): string | undefined {
  const names = [...text.matchAll(/\{(\w+)\}/g)].map((match) => match[1] ?? "");
  const unknown = names.some((name) => (details[name] ?? "") === "");
  if (unknown) return undefined;
  const said = names.map((name) => {
    const value = details[name] ?? "";
    return [name, typeof value === "number" ? number(name, value) : value];
  });
  return fill(text, Object.fromEntries(said) as Record<string, string>);
}

/** Numbers of a sentence as a person says them; the unit is in the name. */
function number(name: string, value: number): string {
  if (name.endsWith("_ratio")) return `${(100 * value).toFixed(1)} %`;
  if (name.endsWith("_rad")) return `${fixed((value * 180) / Math.PI, 1)}°`;
  return Math.abs(value) >= 10 ? fixed(value, 0) : String(Number(value.toPrecision(2)));
}
