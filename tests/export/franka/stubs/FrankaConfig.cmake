# In place of libfranka: headers of our own, with an arm of the scenario's behind them.
add_library(Franka::Franka INTERFACE IMPORTED)
set_target_properties(Franka::Franka PROPERTIES INTERFACE_INCLUDE_DIRECTORIES ${CMAKE_CURRENT_LIST_DIR})
