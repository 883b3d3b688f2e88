"""The four scenes of SmallVCM (Georgiev et al., "Light transport simulation with vertex connection and merging", 2012;
github.com/SmallVCM): a box, open to the eye, with a glossy floor and balls of mirror and glass, under a sun, a lamp, a
point light or a sky. Geometry, lights and eye are those of its src/scene.hxx, with y up.

What differs: the floor's gloss is GGX's in the place of Phong's, with as much light and of the same width; balls are of
flat triangles with smooth normals."""
import math

import numpy as np

import glb

CAMERA = ("--from=-0.0439815,0.222539,4.12529", "--to=-0.03709525,0.1683229,3.126785", "--field-of-view", "45")
NAMES = ("sun", "lamp", "point", "sky")  # in the order of SmallVCM's -s 0 to 3
LOW, HIGH = np.array([-1.27029, -1.28002, -1.30455]), np.array([1.28975, 1.28002, 1.25549])
GREEN, RED, BLUE, WHITE = ((0.156863, 0.803922, 0.172549), (0.803922, 0.152941, 0.152941),
                           (0.156863, 0.172549, 0.803922), (0.803922, 0.803922, 0.803922))
MATT, GLOSSY, EXPONENT = 0.1, 0.7, 90.0  # of the floor
SMALL, LARGE = 0.5, 0.8  # radii of balls


def floor_of(scene):
    """Metal that covers a part of it, and what is matt, add up to SmallVCM's two reflectances; GGX's alpha is
    sqrt(2 / (exponent + 2))."""
    color = MATT + GLOSSY
    return glb.gloss(scene, "floor", (color,) * 3, GLOSSY / color, (2.0 / (EXPONENT + 2.0)) ** 0.25)


def walls(scene, ceiling_is_low):
    """The box without its front; boards about the lamp where the ceiling has one."""
    (x0, y0, z0), (x1, y1, z1) = LOW, HIGH
    white = scene.material("white", WHITE)
    scene.quad("floor", [(x0, y0, z1), (x1, y0, z1), (x1, y0, z0), (x0, y0, z0)], floor_of(scene))
    scene.quad("back", [(x0, y0, z0), (x1, y0, z0), (x1, y1, z0), (x0, y1, z0)], scene.material("blue", BLUE))
    scene.quad("ceiling", [(x0, y1, z0), (x1, y1, z0), (x1, y1, z1), (x0, y1, z1)], white)
    scene.quad("left", [(x0, y0, z1), (x0, y0, z0), (x0, y1, z0), (x0, y1, z1)], scene.material("green", GREEN))
    scene.quad("right", [(x1, y0, z0), (x1, y0, z1), (x1, y1, z1), (x1, y1, z0)], scene.material("red", RED))
    if ceiling_is_low:
        corners = [(-0.25, -0.25), (0.25, -0.25), (0.25, 0.25), (-0.25, 0.25)]  # x and z
        for i, (a, b) in enumerate(zip(corners, corners[1:] + corners[:1])):
            low, high = y1 - 0.02, y1
            scene.quad("board%d" % i, [(b[0], low, b[1]), (a[0], low, a[1]), (a[0], high, a[1]), (b[0], high, b[1])],
                       white)


def lamp(scene, radiance, albedo):
    """The underside of the boards."""
    low = HIGH[1] - 0.02
    scene.quad("lamp", [(-0.25, low, -0.25), (0.25, low, -0.25), (0.25, low, 0.25), (-0.25, low, 0.25)],
               scene.material("lamp", albedo, radiance=(radiance,) * 3))


def balls(scene, large, rings):
    (x0, y0, z0), (x1, _, z1) = LOW, HIGH
    mirror = glb.gloss(scene, "mirror", metallic=1.0)
    middle, third = (z0 + z1) / 2, 2.0 * (x1 - x0) / 7.0
    if large:
        glb.ball(scene, "mirror ball", ((x0 + x1) / 2, y0 + LARGE, middle), LARGE, mirror, rings)
        return
    glass = glb.gloss(scene, "glass", ior={"ior": 1.6}, **glb.GLASS)
    glb.ball(scene, "mirror ball", (x0 + third, y0 + SMALL, middle), SMALL, mirror, rings)
    glb.ball(scene, "glass ball", (x1 - third, y0 + SMALL, middle), SMALL, glass, rings)


def turned_to(direction):
    """The rotation (x y z w) that takes -z to a direction."""
    to = np.array(direction) / np.linalg.norm(direction)
    turn = np.append(np.cross((0, 0, -1), to), 1.0 - to[2])
    return [float(c) for c in turn / np.linalg.norm(turn)]


def write(path, name, rings=32):
    """Writes one of NAMES. Radiance, intensity and irradiance have SmallVCM's numbers."""
    scene = glb.Scene()
    walls(scene, name != "point")
    balls(scene, name == "lamp", rings)
    if name == "lamp":
        lamp(scene, 25.03329895614464, (0, 0, 0))
    elif name != "point":
        lamp(scene, 0.0, WHITE)
    if name == "sun":
        scene.light("sun", {"type": "directional", "color": [1.0, 0.4, 0.0], "intensity": 10.0},
                    rotation=turned_to((-1.0, -1.0, -1.5)))
    elif name == "point":
        scene.light("point", {"type": "point", "intensity": 70.0 / (4.0 * math.pi)}, translation=[0.0, 1.0, 0.5])
    elif name == "sky":
        scene.environment((135 / 255, 206 / 255, 250 / 255))
    return scene.write(path)
