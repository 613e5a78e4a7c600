/* The estimators' compiled part, one library: what law_along_record.py calls. */
#ifdef _WIN32
#define API __declspec(dllexport)
#else
#define API __attribute__((visibility("default")))
#endif

#include "laws.c"
#include "joints.c"
#include "likelihood.c"
