import type {
  BoardOut,
  BoardsOut,
  CalibrationWish,
  CalSensor,
  DiffOut,
  DoctorOut,
  ImportedOut,
  InfoOut,
  JobOut,
  LanesOut,
  MagLearningOut,
  PortsOut,
  PreprocessingOut,
  Problem,
  SessionOut,
  SetOut,
  SetsOut,
  SettingsOut,
  SimulatorIn,
  SimulatorOut,
} from "./wire";

/** A refused request, carrying the server's own words. */
export class ApiError extends Error {
  readonly problem: Problem;

  constructor(problem: Problem) {
    super(problem.detail);
    this.problem = problem;
  }
}

/** Resolve below the page's own origin, also behind a path prefix of a proxy. */
export function apiUrl(path: string): URL {
  return new URL(`api/v1/${path}`, document.baseURI);
}

/** The only `fetch` of the page; every failure is an `ApiError`. */
async function ask(method: string, path: string, body?: unknown): Promise<Response> {
  const init: RequestInit = { method, credentials: "same-origin" };
  if (body !== undefined) {
    init.headers = { "Content-Type": "application/json" };
    init.body = JSON.stringify(body);
  }
  const answer = await fetch(apiUrl(path), init).catch(() => null);
  if (!answer) throw new ApiError(unreachable());
  if (!answer.ok) throw new ApiError(await problemOf(answer));
  return answer;
}

async function request<T>(method: string, path: string, body?: unknown): Promise<T> {
  const answer = await ask(method, path, body);
  if (answer.status === 204) return undefined as T;
  return (await answer.json()) as T;
}

function unreachable(): Problem {
  const detail = "navdeck did not answer.";
  return {
    type: "urn:navdeck:problem:service-unreachable",
    title: "Unreachable",
    status: 0,
    detail,
    code: "service-unreachable",
    remedy: "",
    errors: [],
  };
}

async function problemOf(answer: Response): Promise<Problem> {
  const blank = {
    ...unreachable(),
    title: answer.statusText,
    status: answer.status,
    code: `http-${answer.status}`,
  };
  try {
    const body = (await answer.json()) as Partial<Problem>;
    return { ...blank, detail: `${answer.status} ${answer.statusText}`, ...body };
  } catch {
    return { ...blank, detail: `${answer.status} ${answer.statusText}` };
  }
}

const id = encodeURIComponent;

function setsPath(boardId: string): string {
  return `boards/${id(boardId)}/calibration-sets`;
}

export function exportUrl(boardId: string, format: string): string {
  return apiUrl(`${setsPath(boardId)}/export?${new URLSearchParams({ format })}`).href;
}

export const api = {
  info: () => request<InfoOut>("GET", "info"),
  openSession: (token: string) => request<SessionOut>("POST", "session", { token }),
  closeSession: () => request<undefined>("DELETE", "session"),
  boards: () => request<BoardsOut>("GET", "boards"),
  addBoard: (url: string) => request<BoardOut>("POST", "boards", { url }),
  removeBoard: (boardId: string) => request<undefined>("DELETE", `boards/${id(boardId)}`),
  reconnect: (boardId: string) => request<unknown>("POST", `boards/${id(boardId)}/reconnect`),
  /** The last rows of a binary topic, laid out as one message of the stream. */
  history: async (boardId: string, topic: string, seconds: number): Promise<ArrayBuffer> => {
    const query = new URLSearchParams({ topic, seconds: String(seconds) });
    return (await ask("GET", `boards/${id(boardId)}/history?${query}`)).arrayBuffer();
  },
  lanes: (boardId: string) => request<LanesOut>("GET", `boards/${id(boardId)}/lanes`),
  chooseLanes: (boardId: string, lanes: readonly string[]) =>
    request<LanesOut>("PUT", `boards/${id(boardId)}/lanes`, { lanes }),
  /** Null = back to the default. */
  setParameters: (boardId: string, lane: string, values: Readonly<Record<string, number | null>>) =>
    request<LanesOut>("PATCH", `boards/${id(boardId)}/lanes/${id(lane)}/parameters`, values),
  ports: () => request<PortsOut>("GET", "ports"),
  settings: () => request<SettingsOut>("GET", "settings"),
  doctor: () => request<DoctorOut>("GET", "doctor"),
  startCalibration: (boardId: string, wish: CalibrationWish) =>
    request<JobOut>("POST", `boards/${id(boardId)}/calibrations`, wish),
  actOnCalibration: (job: JobOut, action: "cancel" | "confirm" | "verify" | "apply") =>
    request<JobOut>("POST", `boards/${id(job.board_id)}/calibrations/${id(job.id)}/${action}`),
  calibrationSets: (boardId: string) => request<SetsOut>("GET", setsPath(boardId)),
  applySet: (boardId: string, set: string) =>
    request<SetsOut>("POST", `${setsPath(boardId)}/${id(set)}/apply`),
  deleteSet: (boardId: string, set: string) =>
    request<undefined>("DELETE", `${setsPath(boardId)}/${id(set)}`),
  rollBack: (boardId: string, sensor: CalSensor) =>
    request<SetsOut>("POST", `${setsPath(boardId)}/roll-back`, { sensor }),
  takeOff: (boardId: string, sensor: CalSensor) =>
    request<SetsOut>("POST", `${setsPath(boardId)}/take-off`, { sensor }),
  diffSets: (boardId: string, from: string, to: string) =>
    request<DiffOut>("GET", `${setsPath(boardId)}/${id(from)}/diff/${id(to)}`),
  importSets: (boardId: string, name: string, text: string) =>
    request<ImportedOut>("POST", setsPath(boardId), { name, text }),
  simulator: (boardId: string) => request<SimulatorOut>("GET", `boards/${id(boardId)}/simulator`),
  simulate: (boardId: string, command: SimulatorIn) =>
    request<SimulatorOut>("POST", `boards/${id(boardId)}/simulator`, command),
  magLearning: (boardId: string) => request<MagLearningOut>("GET", `boards/${id(boardId)}/mag-learning`),
  setMagLearning: (boardId: string, switches: { run?: boolean; apply?: boolean }) =>
    request<MagLearningOut>("PUT", `boards/${id(boardId)}/mag-learning`, switches),
  keepMagLearning: (boardId: string) => request<SetOut>("POST", `boards/${id(boardId)}/mag-learning/keep`),
  chains: (boardId: string) => request<PreprocessingOut>("GET", `boards/${id(boardId)}/preprocessing`),
  /** Null = back to the default. */
  setChain: (boardId: string, sensor: string, values: Readonly<Record<string, number | null>>) =>
    request<PreprocessingOut>("PATCH", `boards/${id(boardId)}/preprocessing/${id(sensor)}`, values),
};
