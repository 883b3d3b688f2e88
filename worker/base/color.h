/* Luminance: shaders/shared/color.h, for the coordinator too. */
#ifndef KILN_WORKER_BASE_COLOR_H
#define KILN_WORKER_BASE_COLOR_H

#include "shaders/shared/color.h"

#endif
