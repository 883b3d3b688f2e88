#include "coordinator/generate/scenes.h"

const struct kiln_generator kiln_generators[] = {
    {"cornell", "the Cornell box as measured: two blocks, the light flush in the ceiling", 0, kiln_generate_cornell},
    {"cornell-layers", "the box behind shelves: most of its lower part sees no light directly", 0,
     kiln_generate_cornell},
    {"cornell-shapes", "the box with a cube, a ball, a torus, an ellipsoid and a slab under a narrow light", 0,
     kiln_generate_cornell},
    {"cornell-spheres", "the box with a mirror ball and a ball of glass", 0, kiln_generate_cornell},
    {"cornell-water", "the box with water and its waves under a small light: caustics on the floor", 0,
     kiln_generate_cornell},
    {"cornell-statue", "the box with a finely carved statue: --triangles N, default 20000", KILN_TAKES_TRIANGLES,
     kiln_generate_cornell},
    {"cornell-offset", "the box 100 km from the origin", 0, kiln_generate_cornell},
    {"cornell-tiny", "the box a millionth of its size", 0, kiln_generate_cornell},
    {"cornell-huge", "the box a million times its size", 0, kiln_generate_cornell},
    {"furnace", "a closed box whose walls all emit radiance 1: --albedo R, default 0.5", KILN_TAKES_ALBEDO,
     kiln_generate_furnace},
    {"city",
     "blocks of instanced houses, sun, sky, lit windows: --triangles N (1000 to 1e9, default 100000), --seed, "
     "--distinct, "
     "--parts N",
     KILN_TAKES_TRIANGLES | KILN_TAKES_PARTS, kiln_generate_city},
    {"rooms", "rooms with doors between, a lamp in each: --columns N --rows M, default 3 x 2, --seed", KILN_TAKES_GRID,
     kiln_generate_rooms},
    {"lights", "a hall under many small lamps: --columns N --rows M, default 32 x 16, two triangles a lamp",
     KILN_TAKES_GRID, kiln_generate_lights},
    {"mirrors", "a room of four plane mirrors around a lamp: the floor's light is a sum over the lamp's images", 0,
     kiln_generate_mirrors},
    {"prism", "a narrow beam through a prism of dense flint glass, whose dispersion spreads it on a wall", 0,
     kiln_generate_prism},
};
const size_t kiln_generator_count = sizeof kiln_generators / sizeof kiln_generators[0];
