import type { LaneChoiceOut, ParameterOut } from "../api/wire";
import { t } from "../i18n/index.svelte";
import { app } from "../live/app.svelte";
import { lanes } from "../live/lanes.svelte";
import { asMain, switchedOff, switchedOn } from "../logic/lanes";
import { laneName } from "./names";
import { notices } from "./notice.svelte";
import { parameterName } from "./parameterNames";

interface Change {
  readonly boardId: string;
  readonly lane: string;
  readonly name: string;
  readonly before: number | null;
}

/** What was changed last of each lane's settings, to be taken back; newest last. */
class Changes {
  private list = $state.raw<readonly Change[]>([]);

  last(lane: string): Change | undefined {
    return this.list.findLast((each) => each.lane === lane && each.boardId === app.boardId);
  }

  push(change: Change): void {
    this.list = [...this.list, change].slice(-100);
  }

  drop(change: Change): void {
    this.list = this.list.filter((each) => each !== change);
  }
}

export const changes = new Changes();

function providesOf(lane: string): LaneChoiceOut["provides"] {
  return lanes.all.find((each) => each.name === lane)?.provides ?? "full";
}

async function choose(next: readonly string[], said: string): Promise<void> {
  const before = lanes.chosen;
  const undo = (): void => void lanes.choose(before).catch((error: unknown) => notices.failed(error));
  try {
    await lanes.choose(next);
    notices.say({ severity: "info", text: said, action: { label: t("board.undo"), run: undo } });
  } catch (error) {
    notices.failed(error);
  }
}

export async function switchLane(lane: string, on: boolean): Promise<void> {
  const name = laneName(lane);
  if (on) await choose(switchedOn(lanes.chosen, lane), t("lanes.nowOn", { lane: name }));
  else await choose(switchedOff(lanes.chosen, lane, providesOf), t("lanes.nowOff", { lane: name }));
}

export async function makeMain(lane: string): Promise<void> {
  await choose(asMain(lanes.chosen, lane), t("lanes.nowMain", { lane: laneName(lane) }));
}

/** Start the lanes again that were put aside: choosing them anew does. */
export async function restartLanes(): Promise<void> {
  await lanes.choose(lanes.chosen).catch((error: unknown) => notices.failed(error));
}

/** Change one setting of a lane; throws what stands beside its field. Null = back to the default. */
export async function setParameter(
  lane: string,
  parameter: ParameterOut,
  value: number | null,
): Promise<void> {
  await lanes.set(lane, { [parameter.name]: value });
  changes.push({ boardId: app.boardId, lane, name: parameter.name, before: parameter.value });
}

/** Take the last change of a lane's settings back. */
export async function undoParameter(lane: string): Promise<void> {
  const change = changes.last(lane);
  if (!change) return;
  try {
    await lanes.set(lane, { [change.name]: change.before });
    changes.drop(change);
    notices.say({ severity: "info", text: t("par.undone", { name: parameterName(lane, change.name) }) });
  } catch (error) {
    notices.failed(error);
  }
}
