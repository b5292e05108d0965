import { ApiError } from "../api/http";
import { spoken, t } from "../i18n/index.svelte";

export interface NoticeText {
  readonly text: string;
  readonly severity: "info" | "warning";
  readonly action?: { readonly label: string; readonly run: () => void };
}

const SHOWN_MS = 10_000;

class Notices {
  shown = $state.raw<NoticeText | null>(null);
  private timer: ReturnType<typeof setTimeout> | undefined;

  say(notice: NoticeText): void {
    clearTimeout(this.timer);
    this.shown = notice;
    this.timer = setTimeout(() => this.dismiss(), SHOWN_MS);
  }

  dismiss(): void {
    clearTimeout(this.timer);
    this.shown = null;
  }

  failed(error: unknown): void {
    this.say({ severity: "warning", text: t("action.failed", { why: reasonOf(error) }) });
  }
}

/** What went wrong and what to do, in one line. */
export function reasonOf(error: unknown): string {
  if (!(error instanceof ApiError)) return String(error);
  const { code, detail, remedy } = error.problem;
  const words = spoken(code, detail, remedy);
  return [words.cause, words.remedy].filter(Boolean).join(" ");
}

export const notices = new Notices();
