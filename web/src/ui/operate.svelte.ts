import { api } from "../api/http";
import type { BoardOut } from "../api/wire";
import { t } from "../i18n/index.svelte";
import { app } from "../live/app.svelte";
import { notices } from "./notice.svelte";

/** Open a link and look at its board; throws what the form shows. */
export async function connect(url: string): Promise<void> {
  const board = await api.addBoard(url);
  app.choose(board.id);
}

/** Like `connect`, for buttons without a form of their own. */
export async function connectOrSay(url: string): Promise<void> {
  await connect(url).catch((error: unknown) => notices.failed(error));
}

/** Removing is undone, not asked about. */
export async function remove(board: BoardOut): Promise<void> {
  try {
    await api.removeBoard(board.id);
    notices.say({
      severity: "info",
      text: t("board.removed", { name: board.name }),
      action: { label: t("board.undo"), run: () => void connectOrSay(board.url) },
    });
  } catch (error) {
    notices.failed(error);
  }
}

export async function reconnect(board: BoardOut): Promise<void> {
  await api.reconnect(board.id).catch((error: unknown) => notices.failed(error));
}

/** Why operating is not possible in this session; "" when it is. */
export function refusal(): string {
  return app.info && !app.canOperate ? t("role.needOperator") : "";
}
