import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from ggcnn_net2net.architecture import (
    EXTENDED,
    HEADS,
    NAMED,
    NARROW,
    ORIGINAL,
    Architecture,
    ConvLayer,
    architecture_of,
    build_ggcnn,
)
from ggcnn_net2net.errors import ArchitectureError

layers = st.builds(
    ConvLayer,
    kind=st.sampled_from("CT"),
    kernel_size=st.tuples(st.integers(1, 11), st.integers(1, 11)),
    filters=st.integers(1, 64),
    stride=st.integers(1, 3),
)


@pytest.mark.parametrize(
    ("name", "parameters"),
    [("original", 62_420), ("extended", 67_644), ("optimized", 16_104), ("narrow", 4_508), ("shallow", 488)],
)
def test_parameter_counts(name, parameters):
    assert NAMED[name].n_parameters == parameters
    assert NAMED[name].name == name


def test_multiplications():
    """By hand: 10x10 pixels of 3x3x1x2 weights, then 5x5 of 3x3x2x4, back up the same, heads of 2x2x5x4 on 10x10."""
    network = Architecture.parse("C3x3x2s1_C3x3x4s2_T3x3x5s2")
    assert network.multiplications(10) == 100 * 18 + 25 * 72 + 25 * 180 + 100 * 80
    assert NAMED["optimized"].multiplications() > ORIGINAL.multiplications() > 10 * NARROW.multiplications()


def test_strides_of_extended():
    """deeper adds layers of stride 1; the layer it follows keeps its own."""
    assert [layer.stride for layer in EXTENDED.layers] == [3, 2, 2, 1, 1, 1, 2, 2, 3]


@given(st.lists(layers, min_size=1, max_size=10).map(tuple).map(Architecture))
def test_notation_round_trip(architecture):
    assert Architecture.parse(str(architecture)) == architecture


def test_notation_of_the_paper_is_kept():
    text = "C9x9x8_C9x9x8_C5x5x4_C3x3x2_T3x3x2_T5x5x4_T5x5x4_T5x5x4_T5x5x4_T9x9x8_T9x9x8"
    assert str(Architecture.parse(text)) == text
    assert Architecture.parse(" Optimized ") == Architecture.parse(text)


@pytest.mark.parametrize("text", ["", "C9x9", "C9x9x32_", "X9x9x32", "C9x9x32 C5x5x16", "c9x9x32", "C0x9x3", "biggest"])
def test_bad_notation(text):
    with pytest.raises(ArchitectureError, match="expected"):
        Architecture.parse(text)


@pytest.mark.parametrize("name", sorted(NAMED))
def test_built_network(name):
    model = build_ggcnn(name)
    assert model.count_params() == NAMED[name].n_parameters
    assert model.input_shape == (None, 300, 300, 1)
    assert model.output_shape == [(None, 300, 300, 1)] * 4
    assert tuple(model.output_names) == HEADS
    assert architecture_of(model) == NAMED[name]


@settings(max_examples=5, deadline=None)
@given(st.integers(0, 2**31))
def test_seed_decides_the_weights(seed):
    import numpy as np

    first, second, other = (build_ggcnn("shallow", seed=value).get_weights() for value in (seed, seed, seed + 1))
    assert all(np.array_equal(a, b) for a, b in zip(first, second, strict=True))
    assert not np.array_equal(first[0], other[0])
    kernels = [weight for weight in build_ggcnn(NARROW, seed=seed).get_weights() if weight.shape == (2, 2, 8, 1)]
    assert len({kernel.tobytes() for kernel in kernels}) == len(kernels) == 4  # no two layers start alike


def test_strides_that_do_not_lead_back():
    with pytest.raises(ArchitectureError, match="100x100"):
        build_ggcnn("C9x9x32")


def test_other_models_have_no_architecture():
    import keras

    inputs = keras.Input((8, 8, 1))
    outputs = keras.layers.Dense(3)(keras.layers.Flatten()(inputs))
    with pytest.raises(ArchitectureError, match="Flatten"):
        architecture_of(keras.Model(inputs, outputs))
    headless = build_ggcnn(ORIGINAL)
    with pytest.raises(ArchitectureError, match="pos_out"):
        architecture_of(keras.Model(headless.input, headless.layers[3].output))


def test_dilation_has_no_notation():
    import keras

    plain = build_ggcnn("C3x3x4s1")
    config = plain.get_config()
    config["layers"][1]["config"]["dilation_rate"] = (2, 2)
    with pytest.raises(ArchitectureError, match="dilation"):
        architecture_of(keras.Model.from_config(config))


def test_branches_have_no_notation():
    import keras

    inputs = keras.Input((12, 12, 1))
    trunk = keras.layers.Conv2D(4, 3, padding="same")(inputs)
    own = [keras.layers.Conv2D(2, 3, padding="same", name=f"before_{head}")(trunk) for head in HEADS]
    heads = [keras.layers.Conv2D(1, 1, name=head)(tensor) for head, tensor in zip(HEADS, own, strict=True)]
    with pytest.raises(ArchitectureError, match="in a row"):
        architecture_of(keras.Model(inputs, heads))
    skip = keras.layers.Conv2D(4, 3, padding="same")(trunk)
    mixed = [
        keras.layers.Conv2D(1, 1, name=head)(tensor) for head, tensor in zip(HEADS, [skip] * 3 + [trunk], strict=True)
    ]
    with pytest.raises(ArchitectureError, match="in a row"):
        architecture_of(keras.Model(inputs, mixed))


@pytest.mark.parametrize(
    ("layer", "setting", "told"),
    [
        (1, {"activation": "sigmoid"}, "activation 'relu' .* 'sigmoid' in 'conv2d_1'"),
        (1, {"use_bias": False}, "use_bias True .* False in 'conv2d_1'"),
        (1, {"groups": 2}, "groups 1 .* 2"),
        (-1, {"kernel_size": (3, 3)}, r"kernel_size \(2, 2\) .* \(3, 3\) in 'width_out'"),
    ],
)
def test_settings_that_the_notation_does_not_tell(layer, setting, told):
    import keras

    config = build_ggcnn("C3x3x4s1_C3x3x4s1", input_size=12).get_config()
    config["layers"][layer + (layer > 0 and "groups" in setting)]["config"] |= setting
    with pytest.raises(ArchitectureError, match=told):
        architecture_of(keras.Model.from_config(config))
