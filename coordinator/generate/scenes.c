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
    {"city", "blocks of instanced houses, sun, sky, lit windows: --triangles N (1000 to 1e9, default 100000), --seed",
     KILN_TAKES_TRIANGLES, kiln_generate_city},
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

/* From the axes right, up, back of a camera to a quaternion (Shepperd, "Quaternion from Rotation Matrix", 1978). */
void kiln_generate_look(struct kiln_dvec3 direction, double rotation[4])
{
    const struct kiln_dvec3 back = dvec3_scale(direction, -1 / dvec3_length(direction));
    const struct kiln_dvec3 upward = fabs(back.y) > 0.999999 ? dvec3(0, 0, -1) : dvec3(0, 1, 0);
    struct kiln_dvec3 right = dvec3_cross(upward, back);
    right = dvec3_scale(right, 1 / dvec3_length(right));
    const struct kiln_dvec3 up = dvec3_cross(back, right);
    const double m[3][3] = {{right.x, up.x, back.x}, {right.y, up.y, back.y}, {right.z, up.z, back.z}};
    const double trace = m[0][0] + m[1][1] + m[2][2];
    int largest = 3;
    double most = trace;
    for (int i = 0; i < 3; i++)
        if (m[i][i] > most) {
            most = m[i][i];
            largest = i;
        }
    if (largest == 3) {
        const double w = 0.5 * sqrt(fmax(0, 1 + trace));
        rotation[0] = (m[2][1] - m[1][2]) / (4 * w);
        rotation[1] = (m[0][2] - m[2][0]) / (4 * w);
        rotation[2] = (m[1][0] - m[0][1]) / (4 * w);
        rotation[3] = w;
        return;
    }
    const int i = largest, j = (i + 1) % 3, k = (i + 2) % 3;
    const double q = 0.5 * sqrt(fmax(0, 1 + m[i][i] - m[j][j] - m[k][k]));
    rotation[i] = q;
    rotation[j] = (m[j][i] + m[i][j]) / (4 * q);
    rotation[k] = (m[k][i] + m[i][k]) / (4 * q);
    rotation[3] = (m[k][j] - m[j][k]) / (4 * q);
}

int kiln_generate_camera(struct kiln_glb *glb, struct kiln_dvec3 eye, struct kiln_dvec3 target, double angle,
                         double aspect, struct kiln_error *error)
{
    struct kiln_glb_placement placement = {.translation = {eye.x, eye.y, eye.z}};
    const struct kiln_dvec3 towards = dvec3_sub(target, eye);
    kiln_generate_look(towards, placement.rotation);
    return kiln_glb_add_camera(glb, "camera", angle, aspect, dvec3_length(towards) * 1e-3, &placement, error);
}
