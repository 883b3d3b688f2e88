#include "coordinator/generate/camera.h"

/* Converts a camera's axes right, up, back to a quaternion (Shepperd, "Quaternion from Rotation Matrix", 1978). */
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
