"""Views of batches: those of a task's symmetries, the canonical one of each observation, and shifts."""

import numpy as np
import pytest
import symmetric
import torch
from pp_tracked import SYMMETRIES, observations

from usbench.agents.value_based.views import Views, shifted
from usbench.setting import Setting
from usbench.trials import knowledge


def test_views_of_batches_are_those_of_the_symmetries():
    views, seen = Views(SYMMETRIES), observations(8)
    numbers = torch.arange(8)
    viewed = views.observations(seen, numbers)
    for k in range(8):
        one = {name: values[k].numpy() for name, values in seen.items()}
        expected = symmetric.viewed(SYMMETRIES, k, one)
        np.testing.assert_array_equal(viewed["image"][k], expected["image"])
        np.testing.assert_array_equal(viewed["senses"][k], expected["senses"])
    actions = torch.arange(8)[:, None] % 5
    expected = [SYMMETRIES.actions[k, k % 5] for k in range(8)]
    assert views.actions_in(actions, numbers).flatten().tolist() == expected
    assert len(views.state_dict()) == 0


def test_canonical_views_have_no_negative_coordinate():
    views, seen = Views(SYMMETRIES), observations()
    viewed = views.observations(seen, views.canonical(seen))
    assert (viewed["senses"].view(-1, 2, 8)[:, -1, :3] >= 0).all()


@pytest.mark.parametrize(
    ("task", "senses"),
    [("pp-random", ("actions",)), ("pp-random", ()), ("fp-random", ()), ("exam-random", ("actions",))],
)
def test_without_coordinates_all_views_of_an_observation_have_one_canonical_view(task, senses):
    setting = Setting(task=task, senses=senses, n_frames=4)
    symmetries, generator = knowledge.symmetries(setting), torch.Generator().manual_seed(0)
    views, n_actions = Views(symmetries), len(setting.guidance.actions)
    seen = torch.randn(60, 90, 40, 4, generator=generator)
    if senses:
        acted = torch.randint(n_actions, (60, 4), generator=generator)
        told = torch.nn.functional.one_hot(acted, n_actions).float().flatten(1)
        told[:10, :n_actions] = 0  # before the first action
        seen = {"image": seen, "senses": told}
    canonical = views.observations(seen, views.canonical(seen))
    for number in range(len(symmetries)):
        viewed = views.observations(seen, torch.full((60,), number))
        torch.testing.assert_close(
            views.observations(viewed, views.canonical(viewed)), canonical, rtol=0, atol=0
        )


def test_the_last_move_of_each_kind_is_the_first_of_its_two_actions():
    views = Views(knowledge.symmetries(Setting(task="pp-random", senses=("actions",), n_frames=3)))
    # Actions 1 and 2 move left and right, 3 and 4 rotate; 0 stays.
    acted = torch.tensor([[1, 4, 2], [3, 4, 0], [4, 3, 2], [0, 0, 0]])
    told = torch.nn.functional.one_hot(acted, 5).float().flatten(1)
    seen = {"image": torch.zeros(4, 90, 40, 3), "senses": told}
    found = views.observations(seen, views.canonical(seen))["senses"].view(4, 3, 5).argmax(2)
    assert found.tolist() == [[2, 3, 1], [4, 3, 0], [4, 3, 1], [0, 0, 0]]


@pytest.mark.parametrize(
    ("task", "senses"), [("fp-random", ("focus",)), ("exam-random", ("focus", "actions"))]
)
def test_the_focus_alone_tells_no_view_from_another(task, senses):
    setting = Setting(task=task, senses=senses)
    views = Views(knowledge.symmetries(setting))
    images = torch.randn(1, 90, 40, 1, generator=torch.Generator().manual_seed(0))
    told = torch.zeros(2, views.sources.shape[1])
    seen = {"image": torch.cat([images, images.flip(2)]), "senses": told}
    first, second = views.canonical(seen).tolist()
    assert views.mirrored[first] != views.mirrored[second]


def test_every_view_is_drawn_as_often():
    torch.manual_seed(0)
    counts = torch.bincount(Views(SYMMETRIES).drawn(8000))
    assert len(counts) == 8
    assert (counts - 1000).abs().max() < 150


def test_shifts_move_images_sideways_and_repeat_the_edge():
    torch.manual_seed(0)
    images = torch.arange(4.0)[None, None, :, None].repeat(200, 9, 1, 2)
    moved = shifted(images, 1)
    assert torch.equal(moved[:, :1], moved[:, -1:])
    rows = {tuple(row) for row in moved[:, 0, :, 0].tolist()}
    assert rows == {(0, 1, 2, 3), (0, 0, 1, 2), (1, 2, 3, 3)}
