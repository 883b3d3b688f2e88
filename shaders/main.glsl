/* The entry point: last in a kernel file. Threads (x, y) of a compute dispatch form workgroups of 64 along x. A
 * dimension with more workgroups than a device allows continues along z (the host decides: y if there are exactly
 * KILN_FOLD_Y rows, else x). */
#include "shaders/shared/fold.h"

#ifdef KILN_PIPELINE
void main() { kiln_kernel(gl_LaunchIDEXT.x, gl_LaunchIDEXT.y); }
#else
layout(local_size_x = 64, local_size_y = 1, local_size_z = 1) in;

void main()
{
    uvec2 group = gl_WorkGroupID.xy;
    if (gl_NumWorkGroups.y == KILN_FOLD_Y)
        group.y += gl_WorkGroupID.z * KILN_FOLD_Y;
    else
        group.x += gl_WorkGroupID.z * gl_NumWorkGroups.x;
    if (group.x < 0x04000000u) /* beyond, x would start again from 0 */
        kiln_kernel(group.x * 64u + gl_LocalInvocationID.x, group.y);
}
#endif
