/* Memory of paths of pixels that move between kernels. */
KILN_ARRAY(PathTurns, kiln_gpu_path_turn, 8);
KILN_ARRAY(PathStates, kiln_gpu_path_state, 4);
KILN_ARRAY(TurnWords, uint, 4);

#define TURN PathTurns(push.turn).at[0]
#define PATH_STATE(slot) PathStates(TURN.states).at[slot]
