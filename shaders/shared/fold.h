/* Folding of large dispatches: if there are more workgroups than a device takes in y, they continue in z, KILN_FOLD_Y
 * rows for each z. For gpu/submit.c and shaders/main.glsl. */
#ifndef KILN_SHADERS_FOLD_H
#define KILN_SHADERS_FOLD_H

#define KILN_FOLD_Y 32768u

#endif
