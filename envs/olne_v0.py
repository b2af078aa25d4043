"""PettingZoo world of a dynamic game whose open-loop Nash equilibrium (OLNE) is known.

``parallel_env`` is the world; ``raw_env`` and ``env`` are its turn-based (AEC) forms.
"""

from contextlib import suppress
from importlib import import_module
from typing import TYPE_CHECKING, Any, ClassVar

import gymnasium
import numpy as np
from gymnasium.error import ResetNeeded
from gymnasium.spaces import Box
from pettingzoo import ParallelEnv
from pettingzoo.utils.conversions import parallel_to_aec_wrapper
from pettingzoo.utils.wrappers import OrderEnforcingWrapper

from olne_bench.envs.scenarios import Scenario, checked_seed, get_scenario
from olne_bench.envs.scenarios.scenario import NoEquilibriumError
from olne_bench.envs.solved.equilibrium import certified_equilibrium
from olne_bench.envs.solved.kept_draws import keeping
from olne_bench.envs.worlds.episode import Episode
from olne_bench.envs.worlds.layout import (
    Infos,
    ObservationLayout,
    Spaces,
    SpaceSize,
    Start,
    Step,
    player_index,
)
from olne_bench.games.solve.olne import Certificate, Equilibrium
from olne_bench.plugins import SCENARIO, is_built_in

if TYPE_CHECKING:
    from olne_bench.envs.worlds.rendering import Renderer

__all__ = ["OlneWorld", "env", "make_world", "parallel_env", "raw_env"]

#: ``pettingzoo.test.parallel_api_test`` passes this meaningless option to ``reset``.
_IGNORED_OPTION = "options"

#: Members of a family that a reset without a seed draws at most, as some are infeasible.
_MOST_DRAWS = 20


class OlneWorld(ParallelEnv[str, np.ndarray, np.ndarray]):
    """N vehicles play a dynamic game whose certified equilibrium is known.

    The world moves by the game's own dynamics, so a plan replays exactly. Rewards are negative
    stage costs under the true weights. A player's return over a whole episode is therefore
    ``-J^i``, and no small unilateral deviation from the OLNE increases it (Peters et al. 2021, eqn.
    nash).

    ======================  =====================================================================
    Import                  ``from olne_bench.envs import olne_v0`` Actions
    continuous Parallel API            yes Manual control          no Players
    ``['player_0', ..., 'player_{N-1}']``, N given by the scenario Action shape            ``(m,)``
    float64 Action values           ``[-limit, limit]`` per control, from the scenario's ``limits``
    Observation shape       ``(N*n + 1,)`` float64 State shape             ``(N*n + 1,)`` float64
    Episode length          ``T - 1`` steps, T the game's horizon ======================
    =====================================================================

    **Observation**: px [m], py [m], heading [rad] and speed [m/s] of the player itself, then of
    each other player by index, then the time since the start [s]. That is for the unicycle (n = 4);
    other models have other components. ``observation_layout`` splits an observation. ``state()``
    returns the same numbers with all players in the order of their indices. Both are exact;
    ``envs.worlds.wrappers`` adds noise and partial views.

    **Action**: for the unicycle (m = 2), yaw rate [rad/s] and acceleration [m/s^2], held for one
    step of ``dt`` seconds. One outside the action space is an error: a clipped plan would be
    another plan.

    **Reward**: player i receives minus its running cost at (x_t, u_t) for the step from t to t+1.
    The last step of the game also subtracts the final cost at x_T. Nothing is discounted.

    **Info** of a player: ``olne_action`` (m,) is its next control in the OLNE, which is open loop;
    it is absent once the game is over. ``weights`` (K,) are the player's true weights in the order
    of ``scenario.game.weight_names``. With ``reveal_truth=False`` both are absent and no
    equilibrium is solved. Where the game has hard constraints, ``violations`` says by how much the
    present states and the last controls break those that look at the player, in the unit of their
    margins. Its keys are the constraint's name and its players: ``("distance", "player_0",
    "player_1")``. The world does not enforce them.

    **End**: all players terminate together after T - 1 steps, when the game ends. A smaller
    ``max_cycles`` truncates the episode before that; the final cost is then never charged.

    **Reset**: ``seed`` picks the member of a scenario family, as ``get_scenario(name, seed)`` does.
    Without a seed, a family draws a new member. ``options={"scenario": name, **its_options}`` plays
    another scenario for one episode, ``options={"num_players": 3}`` the same one with other
    options. Players and spaces are those of the latest scenario, and the same objects unless it
    differs in size. Learners and third-party wrappers read them once, so they should stay with one
    scenario and give ``num_players`` to ``random``.

    **Pictures** show the vehicles from above. The x axis points right and the y axis points up, so
    headings grow counterclockwise. A scene that is taller than wide is turned: then x points down
    and y to the right. pygame has one window per process, which shows the world that drew last;
    macOS opens windows in the main thread only.

    **Copies**: ``copy.deepcopy`` and ``pickle`` keep the episode. The copy continues exactly as the
    original would, shares nothing with it, and opens its own window when it draws.

    Args:
        scenario: name of a scenario (``envs.scenarios.scenario_names()``) or a ``Scenario``.
        max_cycles: steps after which an episode is truncated; None plays the whole game.
        render_mode: ``"human"`` (a window), ``"rgb_array"`` or None.
        reveal_truth: whether infos carry ``olne_action`` and ``weights``.
        **scenario_options: the scenario's own options, such as ``num_players`` of ``random``.

    Attributes:
        possible_agents: all players of the latest scenario.
        agents: the same during an episode, empty before and after.
        np_random: draws the members of a family for resets without a seed.

    Raises:
        ValueError: on an unknown scenario, option or render mode, a ``max_cycles`` below 1, or a
            scenario without ``limits``.

    Version history:
        * v0: first version.
    """

    metadata: ClassVar[dict[str, Any]] = {
        "name": "olne_v0",
        "render_modes": ["human", "rgb_array"],
        "render_fps": 5,
        "is_parallelizable": True,
    }

    def __init__(
        self,
        scenario: str | Scenario = "highway_overtaking",
        *,
        max_cycles: int | None = None,
        render_mode: str | None = None,
        reveal_truth: bool = True,
        **scenario_options: Any,
    ) -> None:
        if max_cycles is not None and max_cycles < 1:
            raise ValueError(f"max_cycles must be at least 1, got {max_cycles}")
        if render_mode not in (None, *self.metadata["render_modes"]):
            raise ValueError(
                f"unknown render_mode {render_mode!r}; known are: "
                f"{', '.join(self.metadata['render_modes'])}"
            )
        self.max_cycles = max_cycles
        self.render_mode = render_mode
        self.reveal_truth = reveal_truth
        self.agents: list[str] = []
        self._default = (scenario, scenario_options)
        self.np_random = np.random.default_rng()
        self._episode: Episode | None = None
        self._renderer: Renderer | None = None
        with keeping(_is_kept(scenario)):
            self._spaces = Spaces(SpaceSize.of(_draw(scenario, 0, scenario_options)))

    # -- what is played ----------------------------------------------------------------------

    @property
    def possible_agents(self) -> list[str]:
        """All players of the latest scenario."""
        return list(self._spaces.actions)

    @property
    def observation_layout(self) -> ObservationLayout:
        """Layout of the observations."""
        return self._spaces.layout

    @property
    def scenario(self) -> Scenario:
        """The scenario of this episode, with its true weights; ResetNeeded before the first."""
        return self._latest_episode().scenario

    @property
    def certificate(self) -> Certificate | None:
        """Evidence that the OLNE of this episode is one; None with ``reveal_truth=False``."""
        truth = self._latest_episode().truth
        return truth.certificate if truth else None

    def observation_space(self, agent: str) -> Box:
        return self._spaces.of_player(agent, self._spaces.observations)

    def action_space(self, agent: str) -> Box:
        return self._spaces.of_player(agent, self._spaces.actions)

    @property
    def state_space(self) -> Box:
        """Space of ``state()``."""
        return self._spaces.state

    # -- playing -----------------------------------------------------------------------------

    def reset(self, seed: int | None = None, options: dict[str, Any] | None = None) -> Start:
        """Start an episode.

        Args:
            seed: member of the scenario family, a non-negative integer.
            options: ``scenario`` and the scenario's own options, for this episode.

        Raises:
            ValueError: on an unknown scenario or option.
            NoEquilibriumError: if the member of this seed has no certified equilibrium within its
                limits (never with ``reveal_truth=False``). Without a seed, members are drawn until
                one has.
        """
        self.agents, self._episode = [], None  # if anything below fails, the old episode is over
        if seed is not None:
            seed = checked_seed(seed)
            self.np_random = np.random.default_rng(seed)
        name, scenario_options = self._choice(options)
        with keeping(_is_kept(name)):
            scenario, size, truth = self._member(name, seed, scenario_options)
        if size != self._spaces.size:
            self._spaces = Spaces(size)
        self._episode = self._new_episode(scenario, truth)
        self.agents = self.possible_agents
        self._renderer = None if self.render_mode is None else self._new_renderer()
        if self.render_mode == "human":
            self.render()
        return self._observations(), self._infos()

    def step(self, actions: dict[str, np.ndarray]) -> Step:
        """Play one step of all players, with one control (m,) each.

        After the end of an episode there are no players: empty actions then give empty results, as
        third-party wrappers expect.

        Raises:
            ResetNeeded: before the first reset, and on any action after the end of an episode.
            ValueError: on a missing or unknown player or an action outside its space. Then nothing
                has moved, and the step may be repeated with other actions.
        """
        episode = self._latest_episode()
        if not self.agents:
            if actions:
                raise ResetNeeded("the episode is over: call reset() before the next step()")
            return {}, {}, {}, {}, {}
        costs = episode.advance(self._spaces.controls(actions, self.agents))
        players = self.agents
        terminated = {p: episode.over or player_index(p) in episode.left for p in players}
        cut = not episode.over and self.max_cycles is not None and episode.steps >= self.max_cycles
        observations, infos = self._observations(), self._infos()
        self.agents = [] if cut else [p for p in players if not terminated[p]]
        if self.render_mode == "human":
            self.render()
        return (
            observations,
            {player: -float(costs[player_index(player)]) for player in players},
            terminated,
            {player: cut and not terminated[player] for player in players},
            infos,
        )

    def check_action(self, player: str, action: np.ndarray) -> None:
        """Refuse an action that ``step`` would refuse, with its ValueError."""
        self._spaces.controls({player: action}, [player])

    def state(self) -> np.ndarray:
        """States in the order of players, then the time [s]: (N*n + 1,); or ResetNeeded."""
        return self._latest_episode().vector()

    def render(self) -> np.ndarray | None:
        """The present state as a (height, width, 3) uint8 array, or in a window."""
        episode = self._latest_episode()
        if self._renderer is None:
            gymnasium.logger.warn(
                'render() draws nothing without a render_mode: make the world with "human" or '
                '"rgb_array"'
            )
            return None
        return self._renderer.draw(episode.history, episode.time)

    def close(self) -> None:
        if self._renderer is not None:
            self._renderer.close()

    # -- details -----------------------------------------------------------------------------

    def _choice(self, options: dict[str, Any] | None) -> tuple[str | Scenario, dict[str, Any]]:
        """Scenario and scenario options of the next episode."""
        given = {key: v for key, v in (options or {}).items() if key != _IGNORED_OPTION}
        scenario, default_options = self._default
        if "scenario" in given:
            return given.pop("scenario"), given
        return scenario, default_options | given

    def _member(
        self, name: str | Scenario, seed: int | None, scenario_options: dict[str, Any]
    ) -> tuple[Scenario, SpaceSize, Equilibrium | None]:
        """The member of a seed; without one, the next member that can be played."""
        for _ in range(_MOST_DRAWS if seed is None else 0):
            with suppress(NoEquilibriumError):
                return self._play(name, int(self.np_random.integers(2**31)), scenario_options)
        last = int(self.np_random.integers(2**31)) if seed is None else seed
        return self._play(name, last, scenario_options)

    def _play(
        self, name: str | Scenario, seed: int, scenario_options: dict[str, Any]
    ) -> tuple[Scenario, SpaceSize, Equilibrium | None]:
        """A member, its size and, if it is revealed, its equilibrium."""
        scenario = _draw(name, seed, scenario_options)
        size = SpaceSize.of(scenario)
        return scenario, size, _equilibrium_within(scenario, size) if self.reveal_truth else None

    def _latest_episode(self) -> Episode:
        if self._episode is None:
            raise ResetNeeded("no episode has been started: call reset() first")
        return self._episode

    def _observations(self) -> dict[str, np.ndarray]:
        vector = self._latest_episode().vector()
        order = self._spaces.observation_order
        return {player: vector[order[player]] for player in self.agents}

    def _infos(self) -> Infos:
        episode = self._latest_episode()
        infos = self._violations()
        if episode.truth is None:
            return infos
        for player in self.agents:
            index = player_index(player)
            infos[player]["weights"] = episode.scenario.weights[index].copy()
            if not (episode.over or index in episode.left):
                infos[player]["olne_action"] = episode.truth.controls[episode.steps, index].copy()
        return infos

    def _violations(self) -> Infos:
        """For each player, the violation of the constraints that look at it."""
        episode = self._latest_episode()
        infos: Infos = {player: {} for player in self.agents}
        constraints = episode.scenario.game.constraints
        if not constraints:
            return infos
        found = episode.violations()
        for player in self.agents:
            index = player_index(player)
            infos[player]["violations"] = {
                (one.name, *(f"player_{j}" for j in one.players)): float(violation)
                for one, violation in zip(constraints, found, strict=True)
                if index in one.players
            }
        return infos

    def _new_episode(self, scenario: Scenario, truth: Equilibrium | None) -> Episode:
        return Episode(scenario, truth)

    def _new_renderer(self) -> "Renderer | None":
        episode = self._latest_episode()
        human = self.render_mode == "human"
        expected = episode.truth.states if episode.truth else episode.states[None]
        from olne_bench.envs.worlds.rendering import Renderer  # pygame takes a while to import

        return Renderer(
            episode.scenario, expected, fps=self.metadata["render_fps"] if human else None
        )


class AecWorld(parallel_to_aec_wrapper):
    """PettingZoo's converter with players and spaces updated at each reset."""

    def reset(self, seed: int | None = None, options: dict[str, Any] | None = None) -> None:
        super().reset(seed=seed, options=options)
        self.possible_agents = self.env.possible_agents
        self.state_space = self.env.state_space

    def step(self, action: np.ndarray | None) -> None:
        """Play one player's turn; a wrong action is refused at once and changes nothing.

        Raises ValueError as ``OlneWorld.step``; the same player may then be given another action.
        """
        player = self.agent_selection
        if not (self.terminations[player] or self.truncations[player]):
            self.env.check_action(player, action)
        super().step(action)


def raw_env(scenario: str | Scenario = "highway_overtaking", **arguments: Any) -> AecWorld:
    """The world with the turn-based (AEC) interface; arguments as for ``parallel_env``."""
    return AecWorld(OlneWorld(scenario, **arguments))


def env(scenario: str | Scenario = "highway_overtaking", **arguments: Any) -> OrderEnforcingWrapper:
    """``raw_env`` with PettingZoo's checks of the order of calls."""
    return OrderEnforcingWrapper(raw_env(scenario, **arguments))


parallel_env = OlneWorld


def make_world(scenario: Scenario, **arguments: Any) -> OlneWorld:
    """The PettingZoo world that a scenario names, for this scenario; ValueError without ``limits``.

    The world's module is imported at its first use, because importing a simulator takes a second.
    """
    world: OlneWorld = import_module(f"olne_bench.envs.{scenario.world}").parallel_env(
        scenario, **arguments
    )
    return world


def _draw(scenario: str | Scenario, seed: int, options: dict[str, Any]) -> Scenario:
    if not isinstance(scenario, Scenario):
        return get_scenario(scenario, seed, **options)
    if options:
        raise ValueError(f"a Scenario object takes no options, got {', '.join(options)}")
    return scenario


def _is_kept(scenario: str | Scenario) -> bool:
    """Whether draws are kept on disk: those of built-in scenarios by name, whose code is known."""
    return isinstance(scenario, str) and is_built_in(SCENARIO, scenario)


def _equilibrium_within(scenario: Scenario, size: SpaceSize) -> Equilibrium:
    """The certified equilibrium, if the world accepts its controls."""
    truth = certified_equilibrium(scenario)
    for name, limit, controls in zip(
        size.control_names, size.control_limits, np.moveaxis(truth.controls, -1, 0), strict=True
    ):
        largest = np.abs(controls).max()
        if largest > limit:
            raise NoEquilibriumError(
                f"the equilibrium of {scenario.name!r} has a {name} of up to {largest:.3g}, "
                f"beyond the scenario's limit of {limit:.3g}"
            )
    return truth
