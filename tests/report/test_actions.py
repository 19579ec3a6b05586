"""What an agent does in every pose: actions as the agent itself takes them."""

from dataclasses import asdict

from usbench.envs.tasks.probe_plane import PROBE_PLANE
from usbench.report import actions
from usbench.setting import make_env
from usbench.trials import model_loading


def test_actions_are_those_that_the_agent_takes_after_a_reset(finished):
    taken = actions.greedy(finished)
    assert taken.shape == (len(PROBE_PLANE.states),)
    agent, env = model_loading.load_agent(finished).agent, make_env("pp")
    for state in (0, 100, 215):
        observation, _ = env.reset(options=asdict(PROBE_PLANE.states[state]))
        assert taken[state] == agent.predict(observation, deterministic=True)[0]
