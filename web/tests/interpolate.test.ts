import { describe, expect, it } from "vitest";
import { Ring } from "../src/live/ring";
import { LANE_COLUMNS } from "../src/live/columns";
import { DEG, eulerFromQuat, headingDeg, slerp, type Quat } from "../src/logic/angles";
import { between, Playhead } from "../src/logic/interpolate";
import { navStateAt } from "../src/logic/navstate";
import { rowsOf } from "./helpers";

function aboutZ(deg: number): Quat {
  return [Math.cos(deg / DEG / 2), 0, 0, Math.sin(deg / DEG / 2)];
}

describe("between", () => {
  it("never extrapolates", () => {
    expect([-1, 0, 0.5, 1, 7].map((t) => between(0, 1, t))).toEqual([0, 0, 0.5, 1, 1]);
  });

  it("is the later one of two equal times", () => {
    expect(between(2, 2, 2)).toBe(1);
  });
});

describe("Playhead", () => {
  it("never passes the newest row and never goes back, however rows bunch", () => {
    const playhead = new Playhead();
    let [tS, nowS, before] = [100, 0, -Infinity];
    for (let i = 0; i < 500; i++) {
      nowS += 0.016;
      if (i % 7 === 0) {
        tS += 7 * 0.016;
        playhead.arrived(tS, 5, nowS + (i % 3) * 0.004);
      }
      const shownS = playhead.at(nowS);
      expect(shownS).toBeLessThanOrEqual(tS);
      expect(shownS).toBeGreaterThanOrEqual(before);
      before = shownS;
    }
  });

  it("moves as fast as the board's clock while rows are regular", () => {
    const playhead = new Playhead();
    for (let i = 0; i <= 100; i++) playhead.arrived(50 + i * 0.02, 1, i * 0.02 + 0.003);
    const [a, b] = [playhead.at(2.004), playhead.at(2.014)];
    expect(b - a).toBeCloseTo(0.01, 4);
  });

  it("stands still when the rows stop", () => {
    const playhead = new Playhead();
    for (let i = 0; i <= 100; i++) playhead.arrived(i * 0.02, 1, i * 0.02);
    expect(playhead.at(60)).toBe(2);
  });

  it("follows a restart to earlier times", () => {
    const playhead = new Playhead();
    playhead.arrived(500, 1, 0);
    playhead.at(1);
    playhead.reset();
    playhead.arrived(3, 1, 2);
    expect(playhead.at(9)).toBe(3);
  });

  it("knows nothing before the first row", () => {
    expect(new Playhead().at(1)).toBeNaN();
  });
});

describe("slerp", () => {
  it("goes the short way round through north", () => {
    const { yawRad } = eulerFromQuat(slerp(aboutZ(350), aboutZ(10), 0.5));
    expect(headingDeg(yawRad)).toBe(0);
  });

  it("does not care about the sign of a quaternion", () => {
    const [w, x, y, z] = aboutZ(30);
    expect(headingDeg(eulerFromQuat(slerp(aboutZ(20), [-w, -x, -y, -z], 0.5)).yawRad)).toBe(25);
  });

  it("keeps unit norm", () => {
    expect(Math.hypot(...slerp(aboutZ(0), aboutZ(120), 0.3))).toBeCloseTo(1, 12);
  });
});

describe("eulerFromQuat", () => {
  it("reads a single turn about each axis", () => {
    const [c, s] = [Math.cos(0.1), Math.sin(0.1)];
    expect(eulerFromQuat([c, s, 0, 0]).rollRad).toBeCloseTo(0.2, 12);
    expect(eulerFromQuat([c, 0, s, 0]).pitchRad).toBeCloseTo(0.2, 12);
    expect(eulerFromQuat([c, 0, 0, -s]).yawRad).toBeCloseTo(2 * Math.PI - 0.2, 12);
  });

  it("stays finite with the nose straight up", () => {
    expect(eulerFromQuat([Math.SQRT1_2, 0, Math.SQRT1_2, 0]).pitchRad).toBeCloseTo(Math.PI / 2, 6);
  });
});

describe("navStateAt", () => {
  function ringOf(
    ...rows: readonly (readonly [tS: number, yawDeg: number, downM: number, velN: number])[]
  ): Ring {
    const ring = new Ring(LANE_COLUMNS, 16);
    const data = rows.map(([, yawDeg, downM, velN]) =>
      LANE_COLUMNS.map((name) => {
        const q = ["q_w", "q_x", "q_y", "q_z"].indexOf(name);
        if (q >= 0) return aboutZ(yawDeg)[q] as number;
        return { pos_d_m: downM, vel_n_m_s: velN, vel_e_m_s: 0, vel_d_m_s: 1 }[name as string] ?? NaN;
      }),
    );
    ring.append(
      rowsOf(
        rows.map(([tS]) => tS),
        data,
      ),
    );
    return ring;
  }

  it("lies between the two rows around the moment", () => {
    const state = navStateAt(ringOf([1, 10, -20, 4], [2, 20, -30, 8]), 1.5);
    expect(headingDeg(state.yawRad)).toBe(15);
    expect(state.heightM).toBeCloseTo(25, 5);
    expect(state.speedMS).toBeCloseTo(6, 5);
    expect(state.climbMS).toBeCloseTo(-1, 5);
  });

  it("is the newest row afterwards, not a guess", () => {
    const state = navStateAt(ringOf([1, 10, -20, 4], [2, 20, -30, 8]), 99);
    expect(headingDeg(state.yawRad)).toBe(20);
    expect(state.heightM).toBeCloseTo(30, 5);
  });

  it("leaves unknown unknown", () => {
    const ring = ringOf([1, 0, NaN, NaN]);
    expect(navStateAt(ring, 1).heightM).toBeNaN();
    expect(navStateAt(ring, 1).posNM).toBeNaN();
  });
});
