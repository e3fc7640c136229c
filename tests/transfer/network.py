"""A small network that reads normals, contact and height of a pad from the change of its image; and how far off it is.

Each pixel is judged by itself, from the change of colour there and around it (three widths of blur, eight directions)
and from its place, by two hidden layers. NumPy and Adam; a few thousand steps take less than a minute on one core.
"""

import functools

import numpy

# Standard deviation of a blur and the distance at which it is looked at, in pixels of the reduced image.
RINGS = (1.5, 4), (3.0, 10), (6.0, 24)
LEVELS = 64.0  # grey levels of change that count as one
REACH_MM = 2.0  # over longer distances the height is the network's own, over shorter ones that of its slopes


@functools.cache
def blurring(size, sigma):
    """The matrix that blurs a line of pixels, the border repeated."""
    reach = int(3 * sigma + 0.5)
    matrix = numpy.zeros((size, size), "float32")
    for step in range(-reach, reach + 1):
        at = numpy.arange(size)
        matrix[at, (at + step).clip(0, size - 1)] += numpy.exp(-0.5 * (step / sigma) ** 2)
    return matrix / matrix.sum(axis=1, keepdims=True)


def blur(image, sigma):
    """Gaussian blur of an image (rows, columns, channels)."""
    lines = (blurring(image.shape[0], sigma) @ image.reshape(len(image), -1)).reshape(image.shape)
    return blurring(image.shape[1], sigma) @ lines


def features(change, rows, columns):
    """What the network sees of pixels (rows, columns) of one image's change of colour (rows, columns, 3)."""
    height, width, _ = change.shape
    parts = [change[rows, columns]]
    for sigma, distance in RINGS:
        blurred = blur(change, sigma)
        parts.append(blurred[rows, columns])
        for angle in numpy.arange(8) * numpy.pi / 4:
            y = (rows + round(distance * numpy.sin(angle))).clip(0, height - 1)
            x = (columns + round(distance * numpy.cos(angle))).clip(0, width - 1)
            parts.append(blurred[y, x])
    place = numpy.stack([2 * columns / width - 1, 2 * rows / height - 1], axis=1)
    return numpy.concatenate([part / LEVELS for part in parts] + [place], axis=1).astype("float32")


def sample(presses, pixels, random):
    """Features and labels of pixels drawn from each press: half of them where the pad is displaced, half anywhere."""
    inputs, labels = [], []
    for change, normal, contact, surface in zip(presses.change, presses.normal, presses.contact, presses.surface):
        near = numpy.flatnonzero(numpy.abs(surface) > 0.01)
        some = random.integers(surface.size, size=pixels)
        if len(near):
            some[: pixels // 2] = random.choice(near, pixels // 2)
        rows, columns = numpy.unravel_index(some, surface.shape)
        inputs.append(features(change, rows, columns))
        layers = normal[rows, columns, 0], normal[rows, columns, 1], contact[rows, columns], surface[rows, columns]
        labels.append(numpy.stack(layers, axis=1))
    return numpy.concatenate(inputs), numpy.concatenate(labels).astype("float32")


def forward(weights, inputs):
    """The values of all layers; the last: normal x and y, logit of contact, height."""
    layers = [inputs]
    for at, (matrix, bias) in enumerate(weights):
        layers.append(layers[-1] @ matrix + bias)
        if at + 1 < len(weights):
            numpy.tanh(layers[-1], out=layers[-1])
    return layers


def fit(sizes, draw, steps, random, rate=4e-3, decay=1e-4):
    """Weights that Adam finds; `draw` gives a batch's inputs, and what makes the loss's slopes of the values for it."""
    weights = [(random.normal(size=(a, b), scale=a**-0.5).astype("float32"), numpy.zeros(b, "float32"))
               for a, b in zip(sizes, sizes[1:])]
    moments = [[numpy.zeros_like(part) for part in layer] for layer in weights for _ in range(2)]
    for step in range(1, steps + 1):
        inputs, slopes_of = draw()
        layers = forward(weights, inputs)
        back = slopes_of(layers[-1])
        now = rate * 0.5 * (1 + numpy.cos(numpy.pi * step / steps)) + 1e-6
        for at in reversed(range(len(weights))):
            matrix, bias = weights[at]
            slopes = layers[at].T @ back, back.sum(axis=0)
            if at:
                back = (back @ matrix.T) * (1 - layers[at] ** 2)
            for part, slope, first, second in zip((matrix, bias), slopes, moments[2 * at], moments[2 * at + 1]):
                first += 0.1 * (slope - first)
                second += 0.001 * (slope * slope - second)
                part -= now * (first / (1 - 0.9**step) / (numpy.sqrt(second / (1 - 0.999**step)) + 1e-8) + decay * part)
    return weights


def train(inputs, labels, units, steps, random, batch=2048):
    """Weights fitted to pixels: squared errors of normal and height, cross entropy of contact."""
    spread = labels.std(axis=0) + 1e-6
    scale = numpy.array([1 / spread[:2].max(), 1 / spread[:2].max(), 1, 1 / spread[3]], "float32")

    def draw():
        some = random.integers(len(inputs), size=batch)

        def slopes_of(out):
            error = out - labels[some] * scale
            error[:, 2] = 1 / (1 + numpy.exp(-out[:, 2])) - labels[some, 2]
            return error / batch

        return inputs[some], slopes_of

    weights = fit((inputs.shape[1], units, units, 4), draw, steps, random)
    matrix, bias = weights[-1]
    scale[2] = 1
    weights[-1] = matrix / scale, bias / scale
    return weights


def integrate(normal, height, mm_per_px):
    """The height whose slopes are those of the normals, and that is `height` over distances beyond REACH_MM."""
    down = numpy.sqrt((1 - (normal**2).sum(axis=2)).clip(0.05))
    slope_x, slope_y = -normal[..., 0] / down, -normal[..., 1] / down
    # Mirrored at the borders, so that nothing jumps there.
    mirror = lambda a, sx, sy: numpy.block([[a, sx * a[:, ::-1]], [sy * a[::-1], sx * sy * a[::-1, ::-1]]])
    rows, columns = height.shape
    wy = 2j * numpy.pi * numpy.fft.fftfreq(2 * rows, mm_per_px)[:, None]
    wx = 2j * numpy.pi * numpy.fft.fftfreq(2 * columns, mm_per_px)[None, :]
    transform = lambda a, sx, sy: numpy.fft.fft2(mirror(a, sx, sy))
    right = transform(height, 1, 1) / REACH_MM**2 - wx * transform(slope_x, -1, 1) - wy * transform(slope_y, 1, -1)
    return numpy.fft.ifft2(right / (1 / REACH_MM**2 - wx**2 - wy**2)).real[:rows, :columns]


def as_normal(out):
    """x and y of the unit normals in what a network gives."""
    return out[..., :2] / numpy.maximum(1, numpy.hypot(out[..., 0], out[..., 1]) / 0.999)[..., None]


def predict(weights, change, mm_per_px):
    """Normals x and y, contact, and height in mm, of one image."""
    height, width, _ = change.shape
    rows, columns = numpy.divmod(numpy.arange(height * width), width)
    out = forward(weights, features(change, rows, columns))[-1].reshape(height, width, 4)
    normal = as_normal(out)
    return normal, out[..., 2] > 0, integrate(normal, out[..., 3], mm_per_px)


def angle_deg(a, b):
    """Angles between unit normals given by x and y."""
    third = lambda n: numpy.sqrt((1 - (n**2).sum(axis=-1)).clip(0))
    return numpy.degrees(numpy.arccos(((a * b).sum(axis=-1) + third(a) * third(b)).clip(-1, 1)))


def errors(weights, presses, flat=False):
    """Means over presses: normal error in the contact in degrees, height RMS there in um, IoU of the contact."""
    found = []
    for change, normal, contact, surface in zip(presses.change, presses.normal, presses.contact, presses.surface):
        if flat:
            guess = numpy.zeros_like(normal), numpy.zeros(contact.shape, bool), numpy.zeros_like(surface)
        else:
            guess = predict(weights, change, presses.mm_per_px)
        there = contact > 0.5
        found.append([
            angle_deg(guess[0][there], normal[there]).mean(),
            1000 * numpy.sqrt(((guess[2] - surface)[there] ** 2).mean()),
            (guess[1] & there).sum() / (guess[1] | there).sum(),
        ])
    return numpy.mean(found, axis=0)


def depth_errors(weights, changes, depths, mm_per_px):
    """For each image, the deepest height found less the known depth, um."""
    return [1000 * (predict(weights, change, mm_per_px)[2].max() - depth) for change, depth in zip(changes, depths)]
