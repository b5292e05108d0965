import type { ParameterOut } from "../api/wire";
import { parameterTexts } from "../i18n/parameters";
import { speech } from "../i18n/index.svelte";

/** Name of a setting in words; one that is not in the table is shown by its key. */
export function parameterName(lane: string, name: string): string {
  return (parameterTexts[`${lane}.${name}`] ?? parameterTexts[name])?.[speech.language] ?? name;
}

/** What a setting does: the service's own English sentence, or ours. */
export function parameterMeaning(lane: string, { name, meaning }: ParameterOut): string {
  const texts = parameterTexts[`${lane}.${name}`] ?? parameterTexts[name];
  return (speech.language === "en" ? texts?.switched : texts?.meaning) ?? meaning;
}
