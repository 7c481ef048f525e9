# cmake -DPROGRAMS=FILE;… -DOUT=FILE -P embed.cmake: the programs as kJudgementPtx, in the order of robot::KernelShape; without programs empty ones.
set(texts "")
foreach(program IN LISTS PROGRAMS)
  file(READ ${program} text)
  string(APPEND texts "R\"ptx(${text})ptx\",\n")
endforeach()
if(NOT PROGRAMS)
  set(texts "\"\", \"\", \"\", \"\"")
endif()
file(WRITE ${OUT} "#include \"models/robot/kernels/kernels.h\"

namespace cotwin::optimisation {

extern const char* const kJudgementPtx[robot::kKernelShapes];
const char* const kJudgementPtx[robot::kKernelShapes] = {${texts}};

}  // namespace cotwin::optimisation
")
