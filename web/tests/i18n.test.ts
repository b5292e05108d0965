import { describe, expect, it } from "vitest";
import { codesZh } from "../src/i18n/codes.zh";
import { en } from "../src/i18n/en";
import { speech, spoken, t, tMaybe } from "../src/i18n/index.svelte";
import { zh } from "../src/i18n/zh";
import { AID_STATUS, AIDS, LANE_STATUS } from "../src/live/columns";
import { signalsOfBoard } from "../src/logic/signals";

const catalogues = { en: en as Readonly<Record<string, string>>, zh: zh as Readonly<Record<string, string>> };

function names(text: string): string[] {
  return [...text.matchAll(/\{(\w+)\}/g)].map((match) => match[1] ?? "").sort();
}

/** Everything but the catalogues themselves. */
const sources = import.meta.glob<string>(
  ["../src/**/*.{ts,svelte}", "!../src/i18n/*", "!../src/api/types.gen.ts"],
  {
    query: "?raw",
    import: "default",
    eager: true,
  },
);

describe("the catalogues", () => {
  it("have the same keys", () => {
    expect(Object.keys(zh).sort()).toEqual(Object.keys(en).sort());
  });

  it("fill in the same names", () => {
    const differing = Object.keys(en).filter(
      (key) => names(catalogues.zh[key] ?? "").join() !== names(catalogues.en[key] ?? "").join(),
    );
    expect(differing).toEqual([]);
  });

  it("have no empty text", () => {
    expect(Object.entries({ ...en, ...zh }).filter(([, text]) => text.trim() === "")).toEqual([]);
  });

  it("have no key that nothing uses", () => {
    const all = Object.values(sources).join("\n");
    const composed =
      /^(place|severity|theme|link|lane|sensor|subject|aid|aidStatus|fix|date|source|q|board\.source|verdict|axis|group\.state|est\.tab|delay\.from|cal\.(?:sensor|kind|is|need|step|check|do|face|pose|value|grade|means|limits|par|card)|learn\.why|chain\.(?:sensor|stage))\.|^learn\.(?:run|apply)(?:Hint)?$/;
    expect(
      Object.keys(en).filter(
        (key) => !composed.test(key) && !all.includes(`"${key}"`) && !all.includes(`'${key}'`),
      ),
    ).toEqual([]);
  });

  it("name every signal, aid and status of the server", () => {
    const wanted = [
      ...signalsOfBoard(["x"]).flatMap(({ group, quantity }) => (group === "aids" ? [] : [`q.${quantity}`])),
      ...AIDS.map((each) => `aid.${each}`),
      ...AID_STATUS.map((each) => `aidStatus.${each}`),
      ...LANE_STATUS.map((each) => `lane.${each}`),
    ];
    expect(wanted.filter((key) => !(key in en))).toEqual([]);
  });
});

describe("t and spoken", () => {
  it("fill in what they are given, in the language chosen", () => {
    speech.language = "en";
    expect(t("state.deadReckoning", { age: "12 s", m: "6" })).toBe("Dead reckoning for 12 s, ± 6 m");
    speech.language = "zh";
    expect(t("state.deadReckoning", { age: "12 s", m: "6" })).toBe("航位推算已 12 s，± 6 m");
    expect(tMaybe("no.such.key")).toBeUndefined();
  });

  it("translate the server by code and fill its numbers in", () => {
    speech.language = "zh";
    expect(spoken("frames-lost", "13.2 % …", "…", { loss_ratio: 0.132 }).cause).toBe(
      "13.2 % 的消息在途中丢失。",
    );
    expect(spoken("no-data", "…", "…", { age_s: 3.4 }).cause).toBe("已 3.4 s 没有传感器数据。");
  });

  it("fall back to the server's English when the code or a name in it is not known", () => {
    speech.language = "zh";
    expect(spoken("brand-new", "Cause.", "Remedy.")).toEqual({ cause: "Cause.", remedy: "Remedy." });
    expect(spoken("port-busy", "It is held.", "Close it.", { device: "/dev/ttyACM0" }).cause).toBe(
      "It is held.",
    );
  });

  it("leave the server's English alone in English", () => {
    speech.language = "en";
    expect(spoken("port-busy", "It is held.", "Close it.")).toEqual({
      cause: "It is held.",
      remedy: "Close it.",
    });
  });

  it("have a cause for every translated code", () => {
    expect(Object.entries(codesZh).filter(([, { cause }]) => !cause)).toEqual([]);
  });
});
