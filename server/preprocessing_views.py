"""From a board's chains and learning to the bodies of the wire."""

from __future__ import annotations

from typing import TYPE_CHECKING

from server.nav.types import STAGE_COLUMNS
from server.wire_lanes import ParameterOut
from server.wire_preprocessing import ChainOut, MagLearningOut, MagLearnOut, PreprocessingOut

if TYPE_CHECKING:
    from server.board import Board
    from server.nav.calibration.mag_learning import MagLearnState
    from server.nav.preprocess.chain_parameters import ChainInfo


def preprocessing_out(board: Board) -> PreprocessingOut:
    """Return the chain of every sensor."""
    return PreprocessingOut(board_id=board.id, sensors=tuple(_chain(info) for info in board.chain()))


def _chain(info: ChainInfo) -> ChainOut:
    fields: dict[str, object] = {
        "sensor": info.name,
        "active": info.active,
        "delay_s": info.delay_s,
        "parameters": tuple(
            ParameterOut(
                name=one.name,
                unit=one.unit,
                default=one.default,
                minimum=one.minimum,
                maximum=one.maximum,
                meaning=one.meaning,
                value=info.values[one.name],
            )
            for one in info.parameters
        ),
        "columns": STAGE_COLUMNS[info.name],
    }
    return ChainOut.model_validate(fields)


def mag_learning_out(board: Board) -> MagLearningOut:
    """Return the switches and what was learned: gauss, body FRD; as long as nothing was, None."""
    run, apply = board.mag_learning_switches
    state = board.mag_learning()
    learned = None if state is None or state.t_ns < 0 else _learned(board, state)
    return MagLearningOut(board_id=board.id, run=run, apply=apply, state=learned)


def _learned(board: Board, state: MagLearnState) -> MagLearnOut:
    ekf = board.snapshot().mag_bias
    fields: dict[str, object] = {
        "t_ns": state.t_ns,
        "offset_gauss": state.offset_gauss.tolist(),
        "sigma_gauss": state.sigma_gauss.tolist(),
        "excitation": state.excitation.tolist(),
        "converged": state.converged,
        "frozen": state.frozen,
        "reason": state.reason,
        "changes": state.changes,
        "residual_gauss": state.residual_gauss,
        "ekf_offset_gauss": ekf[:3],
        "ekf_sigma_gauss": ekf[3:],
    }
    return MagLearnOut.model_validate(fields)
